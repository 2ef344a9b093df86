"""One launch from request to exit status: plan, train, draw, render, summarise."""

import contextlib
import functools
from collections import defaultdict
from collections.abc import Mapping, Sequence

from rich.console import Console

import hac_suite
import tasks
from launch.asking import settings
from launch.asking.request import Request
from launch.folder import manifest
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing, lost_jobs, on_ray, planning, worker
from launch.jobs.local import StopSignal, execute
from launch.jobs.planning import Agent
from launch.jobs.progress import Board
from launch.jobs.recorder import Recorder
from launch.pictures import summary

Standings = dict[Agent, dict[int, checkpointing.Standing]]  # of interrupted runs, by seed


def run(request: Request, command: Sequence[str], *, work=worker.train_job) -> int:
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
    with contextlib.ExitStack() as held:
        cluster = _cluster(request, held)
        stop = held.enter_context(StopSignal())  # after Ray has set signal handlers of its own
        found = _lock(list(folders.values()), request, held, console)
        workers = cluster.workers if cluster else request.workers or manifest.cores()
        asked = {
            "subgoal_layers": list(request.subgoal_layers),
            "seeds": list(request.seeds),
            "periods": request.periods,
        }
        manifests = {
            task: manifest.add_launch(
                _manifest(folder, request), command, workers, request.device, asked
            )
            for task, folder in folders.items()
        }
        recorder = Recorder(folders, manifests, console, request.tensorboard)
        _train(request, recorder, found, workers, work, console, stop, cluster)
        if stop.number is None:
            summary.present(folders.values(), request, console, stop)
        recorder.close(stopped=stop.number is not None)
        return _conclude(request, folders, recorder, console, stop)


def _cluster(request: Request, held: contextlib.ExitStack) -> on_ray.Cluster | None:
    """The Ray cluster that is asked for; None: this machine's own processes do."""
    if request.executor != "ray":
        return None
    return held.enter_context(on_ray.Cluster(request.ray_address, request.workers))


def _lock(
    folders: Sequence[RunFolder],
    request: Request,
    held: contextlib.ExitStack,
    console: Console,
) -> Standings:
    """Locks all folders; what is refused is refused before any folder is made.

    Returns:
      Where the interrupted runs among those asked for stand.
    """
    found: Standings = {}
    there = [folder for folder in folders if folder.path.exists()]
    for folder in there:
        held.enter_context(folder.lock())
    for folder in there:
        horizons = _manifest(folder, request)["horizons"]
        for layers in request.subgoal_layers:
            agent = Agent(folder.task, layers)
            seeds = _unfinished(folder, layers, request)
            run = checkpointing.Run(agent, tuple(horizons[str(layers)]), request.config)
            say = functools.partial(console.print, soft_wrap=True)
            found[agent] = checkpointing.standings(
                folder, run, seeds, request.periods, say, other_versions=request.other_versions
            )
    for folder in folders:
        if folder not in there:
            held.enter_context(folder.lock())
    return found


def _manifest(folder: RunFolder, request: Request) -> manifest.Manifest:
    """The folder's manifest, or a new one, with the horizons of the agents asked for.

    Raises:
      CommandError: the folder holds runs of another configuration.
    """
    max_steps, own = _horizon(folder.task)
    wanted = manifest.new(folder.task, max_steps, settings.as_json(request.config))
    wanted["horizons"] = {
        str(layers): list(hac_suite.horizons(max_steps, layers, {**own, **request.attempts}))
        for layers in request.subgoal_layers
    }
    found = manifest.read(folder.manifest)
    if found is None:
        return wanted
    manifest.check_same(folder.manifest, found, wanted)
    found["horizons"].update(wanted["horizons"])
    return found


@functools.cache
def _horizon(task: str) -> tuple[int, dict[int, tuple[int, ...]]]:
    """A task's control steps, and the attempts of its own that it has for some agents."""
    env = tasks.load_vector(task, 1)
    env.close()
    return env.max_steps, env.horizons


def _train(
    request: Request,
    recorder: Recorder,
    found: Standings,
    workers: int,
    work,
    console: Console,
    stop: StopSignal,
    cluster: on_ray.Cluster | None,
) -> None:
    """Trains what is missing."""
    missing = defaultdict[planning.Group, list[int]](list)
    for task, folder in recorder.folders.items():
        runs: dict[tuple[int, int], list[dict]] = {}
        for layers in request.subgoal_layers:
            agent = Agent(task, layers)
            standings = found.get(agent, {})
            for seed in _missing(folder, layers, request, standings, console):
                standing = standings.get(seed, checkpointing.Standing(0, []))
                runs[layers, seed] = standing.rows
                missing[planning.Group(agent, standing.train_episodes)].append(seed)
        recorder.prepare(task, runs)
    episodes = request.periods * request.config.episodes_per_period
    groups = {group: tuple(seeds) for group, seeds in missing.items()}
    jobs = planning.plan(groups, workers, episodes)
    if not jobs:
        return
    plans = {task: _plan(task, request, recorder) for task in request.tasks}
    say = functools.partial(console.print, soft_wrap=True)
    again = functools.partial(lost_jobs.again, recorder=recorder, plans=plans, say=say)
    run_jobs = functools.partial(cluster.execute, again=again) if cluster else execute
    with Board(jobs, episodes, console) as board:

        def poll() -> None:
            board.tick()
            recorder.tick()

        run_jobs(
            jobs,
            functools.partial(work, plans=plans),
            workers=workers,
            log=lambda job: recorder.folders[job.agent.task].log(job),
            on_message=functools.partial(recorder.receive, board),
            on_poll=poll,
            stop=stop,
        )


def _unfinished(folder: RunFolder, layers: int, request: Request) -> tuple[int, ...]:
    finished = folder.finished(Agent(folder.task, layers), request.periods)
    return tuple(seed for seed in request.seeds if seed not in finished)


def _missing(
    folder: RunFolder,
    layers: int,
    request: Request,
    standings: Mapping[int, checkpointing.Standing],
    console: Console,
) -> tuple[int, ...]:
    """Seeds of an agent that are still to be trained; says which are not, and which go on."""
    agent = Agent(folder.task, layers)
    missing = _unfinished(folder, layers, request)
    finished = set(request.seeds) - set(missing)
    folder.drop_checkpoints((layers, seed) for seed in finished)
    if finished:
        done = len(finished)
        console.print(f"{agent}: {done} of {len(request.seeds)} seeds are finished already")
    if standings:
        episodes = sorted({standing.train_episodes for standing in standings.values()})
        console.print(
            f"{agent}: {len(standings)} seed(s) go on from episode {', '.join(map(str, episodes))}"
        )
    shorter = [
        seed for seed in missing if seed not in standings and folder.has_policy(layers, seed)
    ]
    if shorter:
        console.print(
            f"{agent}: {len(shorter)} seeds were trained for fewer than {request.periods} periods; "
            "they are trained again from the start"
        )
    return missing


def _plan(task: str, request: Request, recorder: Recorder) -> worker.Plan:
    horizons = recorder.manifests[task]["horizons"]
    return worker.Plan(
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
        summary.summarise(folder, console)
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
