"""One launch from request to exit status: plan, train, draw, render, summarise."""

import contextlib
import functools
from collections.abc import Sequence

from rich.console import Console

import hac_suite
import tasks
from launch import manifest, planning, presentation, results, settings, training
from launch.command_line import Request
from launch.execution import StopSignal, execute
from launch.planning import Agent
from launch.progress import Board
from launch.recording import Recorder
from launch.run_folder import RunFolder


def run(request: Request, command: Sequence[str], *, work=training.train_job) -> int:
    """Carries out a checked request.

    Args:
      command: its words, for the manifest.
      work: trains a job, as `training.train_job` does.

    Returns:
      0: everything asked for is in the run folders; 1: some runs failed; 128 + its number: a
      signal stopped the launch.

    Raises:
      CommandError: a run folder is in use, or holds runs of another configuration.
    """
    console = Console()
    folders = {task: RunFolder(request.out, task) for task in request.tasks}
    with contextlib.ExitStack() as held, StopSignal() as stop:
        _lock(list(folders.values()), request, held)
        workers = request.workers or manifest.cores()
        manifests = {
            task: manifest.add_launch(_manifest(folder, request), command, workers, request.device)
            for task, folder in folders.items()
        }
        recorder = Recorder(folders, manifests, console)
        _train(request, recorder, workers, work, console, stop)
        if stop.number is None:
            presentation.present(folders.values(), request, console, stop)
        recorder.close(stopped=stop.number is not None)
        return _conclude(request, folders, recorder, console, stop)


def _lock(folders: Sequence[RunFolder], request: Request, held: contextlib.ExitStack) -> None:
    """Locks all folders; what is refused is refused before any folder is made."""
    there = [folder for folder in folders if folder.path.exists()]
    for folder in there:
        held.enter_context(folder.lock())
    for folder in there:
        _manifest(folder, request)
        results.read(folder.results)
    for folder in folders:
        if folder not in there:
            held.enter_context(folder.lock())


def _manifest(folder: RunFolder, request: Request) -> manifest.Manifest:
    """The folder's manifest, or a new one, with the horizons of the agents asked for.

    Raises:
      CommandError: the folder holds runs of another configuration.
    """
    max_steps = _max_steps(folder.task)
    wanted = manifest.new(folder.task, max_steps, settings.as_json(request.config))
    found = manifest.read(folder.manifest)
    if found is not None:
        manifest.check_same(folder.manifest, found, wanted)
    merged = found or wanted
    for layers in request.subgoal_layers:
        merged["horizons"][str(layers)] = list(hac_suite.horizons(max_steps, layers))
    return merged


@functools.cache
def _max_steps(task: str) -> int:
    env = tasks.load_vector(task, 1)
    env.close()
    return env.max_steps


def _train(
    request: Request,
    recorder: Recorder,
    workers: int,
    work,
    console: Console,
    stop: StopSignal,
) -> None:
    """Trains what is missing."""
    missing = {}
    for task, folder in recorder.folders.items():
        wanted = {
            layers: _missing(folder, layers, request, console) for layers in request.subgoal_layers
        }
        recorder.prepare(
            task, [(layers, seed) for layers, seeds in wanted.items() for seed in seeds]
        )
        missing.update({Agent(task, layers): seeds for layers, seeds in wanted.items()})
    jobs = planning.plan(missing, workers)
    if not jobs:
        return
    plans = {task: _plan(task, request, recorder) for task in request.tasks}
    episodes = request.periods * request.config.episodes_per_period
    with Board(jobs, episodes, console) as board:

        def poll() -> None:
            board.tick()
            recorder.tick()

        execute(
            jobs,
            functools.partial(work, plans=plans),
            workers=workers,
            log=lambda job: recorder.folders[job.agent.task].log(job),
            on_message=functools.partial(recorder.receive, board),
            on_poll=poll,
            stop=stop,
        )


def _missing(folder: RunFolder, layers: int, request: Request, console: Console) -> tuple[int, ...]:
    """Seeds of an agent that are still to be trained; says what is not."""
    agent = Agent(folder.task, layers)
    finished = folder.finished(agent, request.periods)
    missing = tuple(seed for seed in request.seeds if seed not in finished)
    if len(missing) < len(request.seeds):
        done = len(request.seeds) - len(missing)
        console.print(f"{agent}: {done} of {len(request.seeds)} seeds are finished already")
    shorter = [seed for seed in missing if folder.has_policy(layers, seed)]
    if shorter:
        console.print(
            f"{agent}: {len(shorter)} seeds were trained for fewer than {request.periods} periods; "
            "they are trained again from the start"
        )
    return missing


def _plan(task: str, request: Request, recorder: Recorder) -> training.Plan:
    horizons = recorder.manifests[task]["horizons"]
    return training.Plan(
        out=request.out.resolve(),
        config=request.config,
        horizons={layers: tuple(horizons[str(layers)]) for layers in request.subgoal_layers},
        periods=request.periods,
        device=request.device,
    )


def _conclude(
    request: Request,
    folders: dict[str, RunFolder],
    recorder: Recorder,
    console: Console,
    stop: StopSignal,
) -> int:
    """Prints how it ended; returns the exit status."""
    if stop.number is not None:
        console.print("stopped; finished runs are kept, and the same command goes on from there")
        return 128 + stop.number
    for folder in folders.values():
        presentation.summarise(folder, console)
    for job, reason in recorder.failures.items():
        console.print(
            f"failed: {job.agent}, seeds {', '.join(map(str, job.seeds))}: {reason}\n"
            f"  see {folders[job.agent.task].failure(job)}",
            style="red",
            soft_wrap=True,
        )
    if recorder.failures:
        console.print("the same command tries again what failed, and only that")
    return 1 if recorder.failures else 0
