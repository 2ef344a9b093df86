"""The training command line: arguments in, a checked Request or one clear CommandError out."""

import dataclasses
import importlib.util
import os
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, get_args

import torch
from absl import flags
from ml_collections import ConfigDict, config_flags

import hac_suite
from analysis import program
from hac_suite.config import PrecisionName
from hac_suite.learning import learners, mixed
from hac_suite.learning.learner import Learner
from launch.asking import lists, settings

CONFIGS = Path(__file__).parents[1] / "configs"
DEFAULT_CONFIG = CONFIGS / "suite.py"

_HELP = """Trains hierarchical actor-critic; writes a run folder per task: curves, policies, videos.

  python launch/run.py --task=pick_place --seeds=10

Flags:
{flags}
  --config=launch/configs/suite.py    file of hyperparameters to start from

Keys for --config.KEY=VALUE, as hac_suite/config.py explains them:
{keys}

The same command resumes, and repeats nothing that is finished.
Exit status: 0 all done; 1 some runs failed, the others are kept; 2 the command was wrong;
128+n signal n stopped it (130 after Ctrl-C), finished results are kept."""


class Request(NamedTuple):
    """What one launch is asked to do."""

    tasks: tuple[str, ...]
    subgoal_layers: tuple[int, ...]
    attempts: dict[int, tuple[int, ...]]  # (T_0, ..., T_n) of agents that are not to have their own
    seeds: tuple[int, ...]
    periods: int
    out: Path
    workers: int  # 0: one for each core
    video: bool
    keep_policies: tuple[int, ...]  # test periods whose policies stay beside the last ones
    tensorboard: bool
    keep_final: bool  # the state that each seed ends with, for more periods later
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
    return read(define_flags(), argv)


def read(values: flags.FlagValues, argv: Sequence[str], config: Path = DEFAULT_CONFIG) -> Request:
    """As `parse`, for a program that has flags beside those of `define_flags`.

    Args:
      config: the file of hyperparameters that is read where none is given.
    """
    _check_config_words(argv)
    try:
        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
            config_flags.DEFINE_config_file(
                "config", str(config), "hyperparameters", values, sys_argv=list(argv)
            )
            program.parse(values, argv)
        settings_given = values.config
    except (program.CommandError, program.HelpRequested):
        raise
    except (Exception, SystemExit) as error:  # a config file is code: it can do anything
        raise program.CommandError(_of_config(error)) from error
    if not isinstance(settings_given, ConfigDict):
        raise program.CommandError(
            f"config: get_config() gave {repr(settings_given)[:60]}, not a ConfigDict; see "
            "launch/configs/suite.py"
        )
    return _request(values, settings_given)


def _of_config(error: BaseException) -> str:
    """One line on what went wrong in a config file."""
    if isinstance(error, SystemExit):
        return f"config: its file ends the program ({error})"
    lines = str(error).splitlines() or [""]
    return f"config: {lines[0]}" if lines[0].strip() else f"config: {type(error).__name__}"


def help_text() -> str:
    """What --help prints."""
    return _HELP.format(flags=program.describe(define_flags()), keys=config_keys())


def config_keys() -> str:
    """A line for each key of --config.KEY: its default."""
    default = settings.from_preset("suite")
    return "\n".join(f"  {name:<28}{default[name]}" for name in settings.field_names())


def define_flags() -> flags.FlagValues:
    """The flags of training, without --config, which `read` adds: it looks at the words."""
    values = flags.FlagValues()
    lists.define_task(values, "pick_place", f"all, {lists.ANY_TASK}")
    flags.DEFINE_string(
        "seeds", "10", "number of seeds, from 0 on; or the seeds: 100-103, or 3,5", values
    )
    flags.DEFINE_list(
        "subgoal_layers",
        "0,1,2",
        "agents to train, by number of subgoal layers; 0: the flat agent",
        flag_values=values,
    )
    flags.DEFINE_string(
        "T",
        None,
        "most attempts T_0,...,T_n of the levels, as in 20,8,3; with several agents: 20,20/8,8,7",
        values,
    )
    program.define_count(
        values, "periods", 10, "number of test periods after that of the untrained agent", least=1
    )
    flags.DEFINE_string("out", "runs", "folder for the run folders", values)
    _define_machines(values)
    flags.DEFINE_boolean("video", True, "make a video and a 3-D replay of each agent", values)
    flags.DEFINE_list(
        "keep_policies", [], "test periods whose policies are kept in stages/, as in 0,1,3", values
    )
    flags.DEFINE_boolean("tensorboard", False, "write curves for TensorBoard as well", values)
    flags.DEFINE_boolean(
        "keep_final",
        True,
        "keep the final checkpoint of each seed, to allow more --periods later",
        values,
    )
    flags.DEFINE_boolean(
        "other_versions",
        False,
        "resume even from checkpoints of other versions of MuJoCo, torch, ...",
        values,
    )
    return values


def _define_machines(values: flags.FlagValues) -> None:
    """What trains: how many processes, of which machines, on which device."""
    program.define_count(
        values,
        "workers",
        0,
        "training processes at a time; 0: one per core",
        least=0,
        most=1000,
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
        "auto, or HOST:PORT of the head; default: start Ray on this machine",
        values,
    )
    flags.DEFINE_enum(
        "device",
        "cpu",
        ["cpu", "cuda", "auto"],
        "device for learning; auto: the GPU if there is one",
        values,
    )
    flags.DEFINE_enum(
        "precision",
        None,
        list(get_args(PrecisionName)),
        "short for --config.precision; bf16 is faster where the processor has avx512_bf16 or AMX",
        values,
    )


def _request(values: flags.FlagValues, settings_given: ConfigDict) -> Request:
    if values.tensorboard:
        _require("tensorboard", flag="tensorboard", extra="tensorboard")
    _check_ray(values)
    layers = lists.subgoal_layers(values.subgoal_layers)
    config = settings.to_config(settings_given)
    if values.precision:
        config = _with_precision(config, values.precision)
    on_gpu = _learner(config.learner).on_gpu
    device = "cpu" if values.executor == "ray" else _device(values.device, on_gpu)
    asked = Request(
        tasks=lists.tasks_named(lists.task_word(values)),
        subgoal_layers=layers,
        attempts=lists.attempts(values.T, layers),
        seeds=lists.seeds(values.seeds),
        periods=values.periods,
        out=_folder(values.out),
        workers=values.workers,
        video=values.video,
        keep_policies=lists.periods(values.keep_policies, values.periods),
        tensorboard=values.tensorboard,
        keep_final=values.keep_final,
        other_versions=values.other_versions,
        executor=values.executor,
        ray_address=values.ray_address,
        device=device,
        config=config,
    )
    check_precision(asked)
    return asked


def check_precision(asked: Request) -> None:
    """Raises CommandError where this machine, or the learner, lacks the precision."""
    if asked.ray_address is not None:  # the machines of a cluster may have what this one lacks
        return
    config = asked.config
    try:
        mixed.check(config.precision, asked.device, _learner(config.learner))
    except ValueError as error:
        raise program.CommandError(f"config: {error}") from error


def _folder(name: str) -> Path:
    """Raises CommandError for a name in which the shell passed on bytes that are no text."""
    if not name.isprintable():
        raise program.CommandError(f"flag --out={name!r}: give a name of printable characters")
    return Path(name)


def _check_ray(values: flags.FlagValues) -> None:
    """Raises CommandError where the Ray executor cannot do what the flags ask of it."""
    address = values.ray_address
    if values.executor != "ray":
        if address is not None:
            raise program.CommandError(f"flag --ray_address={address}: it needs --executor=ray")
        return
    _require("ray", flag="executor=ray", extra="cluster")
    if address is not None and not re.fullmatch(r"auto|[\w.-]+:\d{1,5}", address, re.ASCII):
        raise program.CommandError(
            f"flag --ray_address={address}: give auto, or HOST:PORT as `ray start` prints it"
        )
    if values.device == "cuda":
        raise program.CommandError("flag --device=cuda: --executor=ray trains on CPUs only")


def _require(package: str, *, flag: str, extra: str) -> None:
    """Raises CommandError where an optional package is not installed."""
    if importlib.util.find_spec(package) is None:
        raise program.CommandError(
            f"flag --{flag}: {package} is not installed; in the repository's folder, "
            f"`python -m pip install -c constraints.txt -e '.[{extra}]'` adds it"
        )


def _learner(word: str) -> type[Learner]:
    """Raises CommandError where it is a class of one's own that cannot be loaded."""
    try:
        return learners.find(word)
    except ValueError as error:
        raise program.CommandError(f"config: {error}") from error


def _device(word: str, on_gpu: bool) -> str:
    """cpu or cuda.

    Args:
      on_gpu: whether the learner can be there.

    Raises:
      CommandError: a GPU is asked for where torch sees none, or for a learner that cannot use it.
    """
    if not on_gpu:
        if word == "cuda":
            raise program.CommandError(
                "flag --device=cuda: this --config.learner learns on CPUs only; leave --device out"
            )
        return "cpu"
    if torch.cuda.is_available():
        return "cuda" if word == "auto" else word
    if word == "cuda":
        build = torch.version.cuda
        why = f"built for CUDA {build}, sees no GPU" if build else "is built without CUDA"
        raise program.CommandError(
            f"flag --device=cuda: the installed torch {torch.__version__} {why}; --device=auto "
            "uses a GPU only if there is one"
        )
    return "cpu"


def _with_precision(config: hac_suite.Config, word: PrecisionName) -> hac_suite.Config:
    """Raises CommandError where the config cannot have it, or is given another."""
    if config.precision not in (word, hac_suite.PRESETS["suite"].precision):
        raise program.CommandError(
            f"flag --precision={word}: it disagrees with --config.precision={config.precision}"
        )
    try:
        return dataclasses.replace(config, precision=word)
    except ValueError as error:
        raise program.CommandError(f"config: {error}") from error


def _check_config_words(argv: Sequence[str]) -> None:
    """Answers a misspelt key or file by name, which config_flags does not."""
    for word, following in zip(argv, [*argv[1:], None], strict=True):
        key = re.match(r"--?(?:no)?config\.([^=]*)", word)
        names = settings.field_names()
        if key and key[1] not in names:
            raise program.CommandError(program.unknown("config key", key[1], names))
        file = re.fullmatch(r"--?config(?:=(.*))?", word, re.DOTALL)
        if file:
            _check_config_file(following if file[1] is None else file[1])


def _check_config_file(name: str | None) -> None:
    if name is None:
        raise program.CommandError("flag --config: give a file, as in --config=my_config.py")
    if not Path(name).is_file():
        own = ", ".join(sorted(os.path.relpath(path) for path in CONFIGS.glob("[!_]*.py")))
        raise program.CommandError(f"there is no config file {name!r}; there are {own}")
