"""Flags become a checked request; whatever is wrong is answered in one line that helps."""

import sys

import pytest
import torch

import hac_suite
import tasks
from analysis import program
from analysis.program import CommandError
from launch.asking import request


def parse(*words: str) -> request.Request:
    return request.parse(["launch/run.py", *words])


def test_defaults_are_the_main_job():
    request = parse()
    assert request.tasks == ("pick_place",)
    assert request.subgoal_layers == (0, 1, 2)
    assert request.seeds == tuple(range(10))
    assert (request.periods, request.workers, request.video) == (10, 0, True)
    assert str(request.out) == "runs"
    assert request.config == hac_suite.PRESETS["suite"]


def test_flags_reach_the_request():
    request = parse(
        "--task=all", "--seeds=3", "--subgoal_layers=2,0", "--periods=4", "--out=x y/ü",
        "--workers=5", "--novideo", "--executor=ray", "--ray_address=10.0.0.1:6379",
        "--tensorboard",
    )  # fmt: skip
    assert request.tasks == tuple(tasks.ALL)
    assert (request.seeds, request.subgoal_layers) == ((0, 1, 2), (0, 2))
    assert request.attempts == {}
    assert (request.periods, request.workers, request.video) == (4, 5, False)
    assert str(request.out) == "x y/ü"
    assert (request.executor, request.ray_address) == ("ray", "10.0.0.1:6379")
    assert request.tensorboard and not parse().tensorboard and parse().executor == "local"


@pytest.mark.parametrize("preset", sorted(hac_suite.PRESETS))
def test_each_preset_has_a_config_file(preset):
    path = request.CONFIGS / f"{preset}.py"
    assert parse(f"--config={path}").config == hac_suite.PRESETS[preset]


def test_overrides_change_one_field_each():
    config = parse(
        "--config.batch_size=32", "--config.discount=1", "--noconfig.bounded_critic",
        "--config.test_draw=each_level", "--config.hidden_sizes=(8, 9)",
    ).config  # fmt: skip
    assert (config.batch_size, config.discount, config.bounded_critic) == (32, 1.0, False)
    assert (config.test_draw, config.hidden_sizes) == ("each_level", (8, 9))
    assert config.learning_rate == hac_suite.PRESETS["suite"].learning_rate


@pytest.mark.parametrize("flag", ["--precision=bf16", "--config.precision=bf16"])
def test_a_precision_is_asked_for_and_checked_on_this_machine(flag, monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": True})
    assert parse(flag).config.precision == "bf16"
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {})
    with pytest.raises(CommandError, match="neither avx512_bf16 nor amx_bf16"):
        parse(flag)
    assert parse(flag, "--executor=ray", "--ray_address=auto").config.precision == "bf16"
    with pytest.raises(CommandError, match="--precision=fp32: it disagrees with --config"):
        parse("--precision=fp32", "--config.precision=bf16")


def test_a_learner_and_its_keys_are_flags():
    config = parse(
        "--config.learner=td3", "--config.target_noise=0.1", "--config.target_noise_clip=1",
        "--config.policy_delay=3",
    ).config  # fmt: skip
    assert (config.learner, config.policy_delay) == ("td3", 3)
    assert (config.target_noise, config.target_noise_clip) == (0.1, 1.0)
    assert parse().config.learner == "ddpg"


@pytest.mark.parametrize(
    ("word", "answer"),
    [
        ("--task=pick_plce", "unknown task 'pick_plce': did you mean 'pick_place'?"),
        ("--task=../pick_place", "unknown task '../pick_place'"),
        ("--task=", "unknown task ''"),
        ("--seeds=0", "--seeds=0"),
        ("--seeds=-1", "--seeds=-1"),
        ("--seeds=abc", "--seeds=abc: give a number of seeds (10: seeds 0 to 9), or the seeds"),
        ("--seeds=9-3", "--seeds=9-3: give a number of seeds"),
        ("--seeds=3,3", "--seeds=3,3: a seed is named twice"),
        ("--seeds=3,1-5", "a seed is named twice"),
        ("--seeds=", "--seeds=: give a number of seeds"),
        ("--seeds=0-999999", "that is 1000000 seeds; give 1 to 10000"),
        ("--T=20,0", "--T=20,0: give a count for each level, the lowest first"),
        ("--T=", "--T=: give a count for each level"),
        ("--T=20,8/30,9", "30,9 is of the agent with 1 subgoal layer(s), twice"),
        ("--T=3,3,3,3", "agent with 3 subgoal layer(s), but not asked for"),
        ("--seeds", "Missing value for flag --seeds"),
        ("--sedes=3", "unknown flag 'sedes': did you mean 'seeds'?"),
        ("--subgoal_layers=7x", "--subgoal_layers=7x: give one or more of 0,1,2"),
        ("--subgoal_layers=3", "--subgoal_layers=3: give one or more of 0,1,2"),
        ("--subgoal_layers=", "--subgoal_layers=: give one or more of 0,1,2"),
        ("--periods=0", "--periods=0"),
        ("--workers=-1", "--workers=-1"),
        ("--seeds=1000000000000", "--seeds=1000000000000"),
        ("--workers=1001", "--workers=1001"),
        ("--periods=1000000000000", "--periods=1000000000000"),
        ("--out=\udcff", "--out='\\udcff': give a name of printable characters"),
        ("--ray_address=auto", "--ray_address=auto: it needs --executor=ray"),
        ("--executor=ray --ray_address=head", "--ray_address=head: give auto, or HOST:PORT"),
        ("--executor=ray --ray_address=ray://head:1", "give auto, or HOST:PORT"),
        ("--executor=ray --device=cuda", "--device=cuda: --executor=ray trains on CPUs only"),
        ("--executor=rai", "--executor=rai: value should be one of <local|ray>"),
        ("--device=gpu", "--device=gpu: value should be one of <cpu|cuda|auto>"),
        ("pick_place", "unexpected word 'pick_place'"),
        ("--config=nope.py", "no config file 'nope.py'; there are launch/configs/paper.py"),
        ("--config nope.py", "no config file 'nope.py'; there are launch/configs/paper.py"),
        ("--config", "--config: give a file"),
        ("--config=", "no config file ''"),
        ("--config.batch_sze=3", "unknown config key 'batch_sze': did you mean 'batch_size'?"),
        ("--config.batch_size=big", "--config.batch_size=big"),
        ("--config.batch_size=1.5", "--config.batch_size=1.5"),
        ("--config.discount=7", "discount is 7.0"),
        ("--config.hidden_sizes=(3,2.5)", "hidden_sizes takes a tuple like (64, 64, 64)"),
        ("--config.test_draw=sometimes", "test_draw is 'sometimes'"),
        ("--config.learner=td4", "config: learner is 'td4'; did you mean 'td3'?"),
        ("--config.learner=nowhere.py:Mine", "config: learner is in 'nowhere.py', and there is no"),
        ("--config.learner=td3 --config.target_rate=0", "target_rate is 0.0; it must be above 0"),
        ("--config.learner=td3 --device=cuda", "flag --device=cuda: this --config.learner learns"),
    ],
)
def test_bad_input_is_answered_in_one_line(word, answer):
    with pytest.raises(CommandError) as caught:
        parse(*word.split(" "))
    assert answer in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("word", "package", "extra"),
    [("--executor=ray", "ray", "cluster"), ("--tensorboard", "tensorboard", "tensorboard")],
)
def test_where_an_extra_is_absent_one_line_says_how_to_install_it(
    monkeypatch, word, package, extra
):
    monkeypatch.setattr(request.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(CommandError) as caught:
        parse(word)
    assert f"{package} is not installed" in str(caught.value)
    assert f"'.[{extra}]'" in str(caught.value) and "\n" not in str(caught.value)


def test_a_gpu_is_taken_only_where_there_is_one(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert (parse().device, parse("--device=auto").device) == ("cpu", "cpu")
    with pytest.raises(CommandError, match=r"--device=cuda: the installed torch .*--device=auto"):
        parse("--device=cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert parse("--device=auto", "--config.learner=td3").device == "cpu"
    assert [parse(f"--device={word}").device for word in ("cpu", "cuda", "auto")] == [
        "cpu",
        "cuda",
        "cuda",
    ]


@pytest.mark.parametrize(
    ("code", "answer"),
    [
        ("1 / 0", "config: division by zero"),
        ("raise RuntimeError", "config: RuntimeError"),
        ("import sys; sys.exit(0)", "config: its file ends the program (0)"),
        ("def get_config(): raise SystemExit('no')", "config: its file ends the program (no)"),
        ("def get_config(): return None", "config: get_config() gave None, not a ConfigDict"),
        ("def get_config(): return [1]", "config: get_config() gave [1], not a ConfigDict"),
        ("def get_config(): return 3", "config: get_config() gave 3, not a ConfigDict"),
        ("def get_config(: pass", "config: "),
        ("settings = 3", "get_config"),
        (
            "from ml_collections import ConfigDict\n"
            "def get_config(): return ConfigDict({'discont': 0.5})",
            "did you mean 'discount'?",
        ),
        (
            "from ml_collections import ConfigDict\n"
            "def get_config(): return ConfigDict({'discount': 'high'})",
            "discount takes a value like 0.98, not 'high'",
        ),
    ],
)
def test_a_broken_config_file_is_answered_in_one_line(tmp_path, monkeypatch, code, answer):
    monkeypatch.delitem(sys.modules, "config_config", raising=False)  # of the file read before
    (tmp_path / "mine.py").write_text(code)
    with pytest.raises(CommandError) as caught:
        parse(f"--config={tmp_path / 'mine.py'}")
    assert answer in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_config_file_after_a_space_is_read():
    path = str(request.CONFIGS / "release_2020.py")
    assert parse("--config", path).config == hac_suite.PRESETS["release_2020"]


def test_help_names_every_flag_and_config_key():
    with pytest.raises(program.HelpRequested):
        parse("--help")
    text = request.help_text()
    for word in (
        "--task=pick_place",
        "--seeds=10",
        "--subgoal_layers=0,1,2",
        "subgoal_test_rate",
        "128+n",
    ):
        assert word in text


@pytest.mark.parametrize(
    ("word", "seeds"),
    [
        ("3", (0, 1, 2)),
        ("100-103", (100, 101, 102, 103)),
        ("3,5", (3, 5)),
        ("7,1-2", (7, 1, 2)),
        ("4-4", (4,)),
        ("0,", None),
    ],
)
def test_seeds_are_a_number_or_a_list(word, seeds):
    if seeds is None:
        with pytest.raises(CommandError):
            parse(f"--seeds={word}")
    else:
        assert parse(f"--seeds={word}").seeds == seeds


def test_attempts_are_given_for_each_agent():
    request = parse("--T=20,20/8,8,7", "--subgoal_layers=1,2")
    assert request.attempts == {1: (20, 20), 2: (8, 8, 7)}
