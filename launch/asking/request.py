"""The training command line: typed words in; a checked Request or one clear CommandError out."""

import importlib.util
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from absl import flags
from ml_collections import ConfigDict, config_flags

import hac_suite
import tasks
from analysis.reading import schema
from hac_suite.learning import learners
from hac_suite.learning.learner import Learner
from launch.asking import errors, program, settings

CONFIGS = Path(__file__).parents[1] / "configs"
DEFAULT_CONFIG = CONFIGS / "paper.py"

_HELP = """Trains hierarchical actor-critic; leaves curves, policies and videos in a folder a task.

  python launch/run.py --task=pick_place --seeds=10

Flags:
{flags}
  --config=launch/configs/paper.py    a file of hyperparameters to start from

Keys for --config.KEY=VALUE, as hac_suite/config.py explains them:
{keys}

The same command again finishes what is missing and repeats nothing.
Exit status: 0 all done; 1 some runs failed, the others are kept; 2 the command was wrong;
128+n signal n stopped it (130 after Ctrl-C), what is finished is kept."""


class Request(NamedTuple):
    """What one launch is to achieve."""

    tasks: tuple[str, ...]
    subgoal_layers: tuple[int, ...]
    attempts: dict[int, tuple[int, ...]]  # (T_0, ..., T_n) of agents that are not to have their own
    seeds: tuple[int, ...]
    periods: int
    out: Path
    workers: int  # 0: one for each core
    video: bool
    tensorboard: bool
    other_versions: bool  # may go on from checkpoints of other versions of the libraries
    executor: str  # local or ray
    ray_address: str | None
    device: str
    config: hac_suite.Config


def parse(argv: Sequence[str]) -> Request:
    """Reads the flags in `argv`, whose first item is the program.

    Raises:
      CommandError: something is misspelt, out of range or of the wrong type; nothing was created.
      HelpRequested: the command asks for help.
    """
    values = _flags()
    _check_config_words(argv)
    try:
        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
            config_flags.DEFINE_config_file(
                "config", str(DEFAULT_CONFIG), "hyperparameters", values, sys_argv=list(argv)
            )
            program.parse(values, argv)
        settings_given = values.config
    except (errors.CommandError, program.HelpRequested):
        raise
    except Exception as error:  # a config file is code: it can raise anything
        raise errors.CommandError(f"config: {error}".splitlines()[0]) from error
    return _request(values, settings_given)


def help_text() -> str:
    """What --help prints."""
    paper = settings.from_preset("paper")
    keys = [f"  {name:<28}{paper[name]}" for name in settings.field_names()]
    return _HELP.format(flags=program.describe(_flags()), keys="\n".join(keys))


def task_names(word: str) -> tuple[str, ...]:
    """The tasks that a --task flag names: one, or `all` of them."""
    if word == "all":
        return tuple(tasks.ALL)
    if word not in tasks.ALL:
        raise errors.CommandError(errors.unknown("task", word, [*tasks.ALL, "all"]))
    return (word,)


def _flags() -> flags.FlagValues:
    values = flags.FlagValues()

    flags.DEFINE_string("task", "pick_place", f"{', '.join(tasks.ALL)}, or all", values)
    flags.DEFINE_string("seeds", "10", "how many, from 0 on; or which: 100-103, or 3,5", values)
    flags.DEFINE_list(
        "subgoal_layers", "0,1,2", "which agents; 0 is DDPG with hindsight", flag_values=values
    )
    flags.DEFINE_string(
        "T",
        None,
        "attempts T_0,...,T_n of the levels, such as 20,8,3; / between agents: 20,20/8,8,7",
        values,
    )
    program.define_count(values, "periods", 10, "test periods after the untrained one", least=1)
    flags.DEFINE_string("out", "runs", "where the run folders go", values)
    program.define_count(
        values, "workers", 0, "processes that train at a time; 0: one for each core", least=0
    )
    flags.DEFINE_enum(
        "executor",
        "local",
        ["local", "ray"],
        "local: on this machine; ray: on a cluster",
        values,
    )
    flags.DEFINE_string(
        "ray_address",
        None,
        "auto, or HOST:PORT of the head; none: a Ray of its own on this machine",
        values,
    )
    flags.DEFINE_enum(
        "device",
        "cpu",
        ["cpu", "cuda", "auto"],
        "where networks learn; auto: the GPU if there is one",
        values,
    )
    flags.DEFINE_boolean("video", True, "render a video of each agent", values)
    flags.DEFINE_boolean("tensorboard", False, "write curves for TensorBoard as well", values)
    flags.DEFINE_boolean(
        "other_versions",
        False,
        "go on from checkpoints that other versions of MuJoCo, torch, ... left",
        values,
    )
    return values


def _request(values: flags.FlagValues, settings_given: ConfigDict) -> Request:
    if values.tensorboard:
        _require("tensorboard", flag="tensorboard", extra="tensorboard")
    _check_ray(values)
    layers = _subgoal_layers(values.subgoal_layers)
    config = settings.to_config(settings_given)
    on_gpu = _learner(config.learner).on_gpu
    return Request(
        tasks=task_names(values.task),
        subgoal_layers=layers,
        attempts=_attempts(values.T, layers),
        seeds=seed_list(values.seeds),
        periods=values.periods,
        out=_folder(values.out),
        workers=values.workers,
        video=values.video,
        tensorboard=values.tensorboard,
        other_versions=values.other_versions,
        executor=values.executor,
        ray_address=values.ray_address,
        device="cpu" if values.executor == "ray" else _device(values.device, on_gpu),
        config=config,
    )


def _folder(name: str) -> Path:
    """Raises CommandError for a name in which the shell passed on bytes that are no text."""
    if not name.isprintable():
        raise errors.CommandError(f"flag --out={name!r}: a folder's name is printable text")
    return Path(name)


def _check_ray(values: flags.FlagValues) -> None:
    """Raises CommandError where the Ray executor cannot do what the flags ask of it."""
    address = values.ray_address
    if values.executor != "ray":
        if address is not None:
            raise errors.CommandError(f"flag --ray_address={address}: it needs --executor=ray")
        return
    _require("ray", flag="executor=ray", extra="cluster")
    if address is not None and not re.fullmatch(r"auto|[\w.-]+:\d{1,5}", address, re.ASCII):
        raise errors.CommandError(
            f"flag --ray_address={address}: it takes auto, or HOST:PORT as `ray start` prints it"
        )
    if values.device == "cuda":
        raise errors.CommandError("flag --device=cuda: --executor=ray trains on CPUs only")


def _require(package: str, *, flag: str, extra: str) -> None:
    """Raises CommandError where an optional package is not installed."""
    if importlib.util.find_spec(package) is None:
        raise errors.CommandError(
            f"flag --{flag}: {package} is not installed; in the repository's folder, "
            f"`python -m pip install -c constraints.txt -e '.[{extra}]'` adds it"
        )


def _learner(word: str) -> type[Learner]:
    """Raises CommandError where it is a class of one's own that cannot be loaded."""
    try:
        return learners.find(word)
    except Exception as error:  # a file of one's own is code: it can raise anything
        raise errors.CommandError(f"config: {error}".splitlines()[0]) from error


def _device(word: str, on_gpu: bool) -> str:
    """cpu or cuda.

    Args:
      on_gpu: whether the learner can be there.

    Raises:
      CommandError: a GPU is asked for where torch sees none, or for a learner that cannot use it.
    """
    if not on_gpu:
        if word == "cuda":
            raise errors.CommandError(
                "flag --device=cuda: this --config.learner learns on CPUs only; leave --device out"
            )
        return "cpu"
    if torch.cuda.is_available():
        return "cuda" if word == "auto" else word
    if word == "cuda":
        build = torch.version.cuda
        why = f"built for CUDA {build}, sees no GPU" if build else "is built without CUDA"
        raise errors.CommandError(
            f"flag --device=cuda: the installed torch {torch.__version__} {why}; "
            "--device=auto takes a GPU only where there is one"
        )
    return "cpu"


def _subgoal_layers(words: Sequence[str]) -> tuple[int, ...]:
    valid = [str(layers) for layers in range(schema.MAX_LEVELS)]
    wrong = [word for word in words if word.strip() not in valid]
    if wrong or not words:
        typed = ",".join(words)
        raise errors.CommandError(
            f"flag --subgoal_layers={typed}: it takes some of {','.join(valid)}, as in "
            "--subgoal_layers=0,1"
        )
    return tuple(sorted({int(word) for word in words}))


def seed_list(word: str) -> tuple[int, ...]:
    """`10` is the seeds 0 to 9; with a comma or a dash it is a list of seeds and ranges.

    Raises:
      CommandError: it is neither, names a seed twice, or more seeds than anyone means.
    """
    parts = [re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", part.strip()) for part in word.split(",")]
    spans = [(int(part[1]), int(part[2] or part[1])) for part in parts if part]
    if len(spans) != len(parts) or any(first > last for first, last in spans):
        raise errors.CommandError(
            f"flag --seeds={word}: it takes how many (10: seeds 0 to 9), or which (100-103 or 3,5)"
        )
    if re.fullmatch(r"\s*\d+\s*", word):
        spans = [(0, spans[0][0] - 1)]
    count = sum(last - first + 1 for first, last in spans)
    if not 1 <= count <= program.MOST:
        raise errors.CommandError(
            f"flag --seeds={word}: that is {count} seeds; it takes 1 to {program.MOST}"
        )
    seeds = [seed for first, last in spans for seed in range(first, last + 1)]
    if len(set(seeds)) < count:
        raise errors.CommandError(f"flag --seeds={word}: a seed is there twice")
    return tuple(seeds)


def _attempts(word: str | None, layers: tuple[int, ...]) -> dict[int, tuple[int, ...]]:
    """By number of subgoal layers, the T of --T; none given: each task's own.

    Raises:
      CommandError: it is not lists of counts, each of an agent that is asked for.
    """
    found: dict[int, tuple[int, ...]] = {}
    for part in word.split("/") if word is not None else []:
        counts = part.split(",")
        if not all(re.fullmatch(r"\s*[1-9]\d{0,5}\s*", count) for count in counts):
            raise errors.CommandError(
                f"flag --T={word}: it takes a count for each level, the lowest first, as in "
                "--T=20,8,3; with / between agents, as in --T=20,20/8,8,7"
            )
        own = len(counts) - 1
        if own not in layers or own in found:
            why = (
                "twice" if own in found else f"but not asked for: --subgoal_layers={_list(layers)}"
            )
            raise errors.CommandError(
                f"flag --T={word}: {part} is of the agent with {own} subgoal layer(s), {why}"
            )
        found[own] = tuple(map(int, counts))
    return found


def _list(numbers: Sequence[int]) -> str:
    return ",".join(map(str, numbers))


def _check_config_words(argv: Sequence[str]) -> None:
    """Answers a misspelt key or file by name, which config_flags does not."""
    for word, following in zip(argv, [*argv[1:], None], strict=True):
        key = re.match(r"--?(?:no)?config\.([^=]*)", word)
        if key and key[1] not in settings.field_names():
            raise errors.CommandError(errors.unknown("config key", key[1], settings.field_names()))
        file = re.fullmatch(r"--?config(?:=(.*))?", word, re.DOTALL)
        if file:
            _check_config_file(following if file[1] is None else file[1])


def _check_config_file(name: str | None) -> None:
    if name is None:
        raise errors.CommandError("flag --config: it takes a file, as in --config=my_config.py")
    if not Path(name).is_file():
        own = ", ".join(sorted(f"launch/configs/{path.name}" for path in CONFIGS.glob("[!_]*.py")))
        raise errors.CommandError(f"there is no config file {name!r}; there are {own}")
