"""One launch from request to exit status: plan, train, draw, render, summarise."""

import contextlib
import functools
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import hac_suite
import tasks
from launch.asking import doubts, settings
from launch.asking.console import Console
from launch.asking.request import Request
from launch.folder import manifest, needs
from launch.folder.agents import Agent, Job
from launch.folder.layout import RunFolder
from launch.jobs import checkpointing, lost_jobs, on_ray, planning, worker
from launch.jobs.checkpointing import ResumePoint
from launch.jobs.local import StopSignal, execute
from launch.jobs.messages import Hooks
from launch.jobs.progress import Board
from launch.jobs.recorder import Recorder
from launch.pictures import summary

_NOT_KEPT = (
    "note: {agent}: --keep_policies comes too late for test period(s) {periods} of {count} "
    "seed(s), which are past them; give another --out to train them again and keep those policies"
)


class Launch(NamedTuple):
    """What all steps of a launch share."""

    request: Request
    folders: Mapping[str, RunFolder]  # by task
    console: Console
    stop: StopSignal
    cluster: on_ray.Cluster | None  # None: this machine's own processes train

    @property
    def workers(self) -> int:
        return self.cluster.workers if self.cluster else self.request.workers or manifest.cores()

    def say(self, text: str) -> None:
        self.console.say(text)


class AgentSeeds(NamedTuple):
    """Where the seeds stand that are asked for of one agent."""

    agent: Agent
    finished: tuple[int, ...]
    interrupted: Mapping[int, ResumePoint]  # they go on from their checkpoints
    new: tuple[int, ...]  # they start from nothing
    again: tuple[int, ...]  # of the new: those that have a policy, but not all of their rows
    warnings: Sequence[str]

    def missing(self, request: Request) -> dict[int, ResumePoint]:
        """Where each seed begins that is to be trained, in the order that they were asked for."""
        begins = {**self.interrupted, **dict.fromkeys(self.new, ResumePoint(0, []))}
        return {seed: begins[seed] for seed in request.seeds if seed in begins}


def run(request: Request, command: Sequence[str], *, work=worker.train_job) -> int:
    """Carries out a checked request.

    Args:
      command: its words, for the manifest.
      work: trains a job, as `worker.train_job` does.

    Returns:
      0: everything asked for is in the run folders; 1: some runs failed; 128 + its number: a
      signal stopped the launch.

    Raises:
      CommandError: a run folder is in use, or holds runs of another configuration.
    """
    with contextlib.ExitStack() as held:
        cluster = _cluster(request, held)
        stop = held.enter_context(StopSignal())  # after Ray has set signal handlers of its own
        folders = {task: RunFolder(request.out, task) for task in request.tasks}
        launch = Launch(request, folders, Console(), stop, cluster)
        there = [folder for folder in folders.values() if folder.path.exists()]
        _lock(there, held)
        # What is refused is refused before a folder is made.
        doubts.refuse_faults(request)
        agents = _agent_seeds(launch, _interrupted(launch, there))
        jobs = _jobs(launch, agents)
        said = [*_other_code(launch, agents), *_doubts(launch, jobs)]
        _lock([folder for folder in folders.values() if folder not in there], held)
        for line in (*doubts.notes(request), *doubts.short(request), *said):
            launch.say(line)
        recorder = _recorder(launch, command, jobs)
        _prepare(launch, recorder, agents)
        _train(launch, recorder, jobs, work)
        if stop.number is None:
            summary.present(folders.values(), request, launch.console, stop)
        recorder.close(stopped=stop.number is not None)
        return _conclude(launch, recorder)


def _cluster(request: Request, held: contextlib.ExitStack) -> on_ray.Cluster | None:
    """The Ray cluster that is asked for; None: this machine's own processes do."""
    if request.executor != "ray":
        return None
    return held.enter_context(on_ray.Cluster(request.ray_address, request.workers))


def _lock(folders: Iterable[RunFolder], held: contextlib.ExitStack) -> None:
    for folder in folders:
        held.enter_context(folder.lock())


def _interrupted(
    launch: Launch, folders: Iterable[RunFolder]
) -> dict[Agent, checkpointing.Interrupted]:
    """Where the interrupted seeds stand of the agents that are asked for.

    Raises:
      CommandError: a folder holds runs of another configuration, or a checkpoint of another run.
    """
    request, found = launch.request, {}
    asked = set(request.seeds)
    for folder in folders:
        horizons = _manifest(folder, request)["horizons"]
        for layers in request.subgoal_layers:
            agent = Agent(folder.task, layers)
            ended = {seed: own for seed, own in folder.ended(agent).items() if seed in asked}
            done = {seed for seed, own in ended.items() if own.period >= request.periods}
            found[agent] = checkpointing.interrupted(
                folder,
                checkpointing.Setup(agent, tuple(horizons[str(layers)]), request.config),
                [seed for seed in request.seeds if seed not in done],
                request.periods,
                other_versions=request.other_versions,
                ended={s: own.period for s, own in ended.items() if own.whole and s not in done},
            )
    return found


def _recorder(launch: Launch, command: Sequence[str], jobs: Sequence[Job]) -> Recorder:
    """What keeps the results, with manifests that know of this launch."""
    request = launch.request
    asked = {
        "subgoal_layers": list(request.subgoal_layers),
        "seeds": list(request.seeds),
        "periods": request.periods,
    }
    manifests = {
        task: manifest.add_launch(
            _manifest(folder, request), command, launch.workers, request.device, asked, jobs
        )
        for task, folder in launch.folders.items()
    }
    return Recorder(
        launch.folders, manifests, launch.console, request.tensorboard, request.keep_final
    )


def _manifest(folder: RunFolder, request: Request) -> manifest.Manifest:
    """The folder's manifest, or a new one, with the horizons of the agents asked for.

    Raises:
      CommandError: the folder holds runs of another configuration.
    """
    spec = tasks.spec(folder.task)
    max_steps, own = spec.max_steps, spec.horizons
    wanted = manifest.new(folder.task, max_steps, settings.as_json(request.config))
    wanted["horizons"] = {
        str(layers): list(hac_suite.horizons(max_steps, layers, {**own, **request.attempts}))
        for layers in request.subgoal_layers
    }
    if own_file := manifest.task_file(tasks.find(folder.task)):
        wanted["task_file"] = own_file
    if of_learner := manifest.learner_file(request.config.learner):
        wanted["learner_file"] = of_learner
    found = manifest.read(folder.manifest)
    if found is None:
        return wanted
    manifest.check_same(folder.manifest, found, wanted)
    found["horizons"].update(wanted["horizons"])
    return found


def _agent_seeds(
    launch: Launch, found: Mapping[Agent, checkpointing.Interrupted]
) -> list[AgentSeeds]:
    """Where the seeds of every agent stand that is asked for."""
    nothing = checkpointing.Interrupted({}, [])
    return [
        _seeds(folder, agent, launch.request, found.get(agent, nothing))
        for task, folder in launch.folders.items()
        for agent in (Agent(task, layers) for layers in launch.request.subgoal_layers)
    ]


def _jobs(launch: Launch, agents: Iterable[AgentSeeds]) -> list[Job]:
    """The jobs that are left."""
    missing = defaultdict[planning.Group, list[int]](list)
    for seeds in agents:
        for seed, begins in seeds.missing(launch.request).items():
            missing[planning.Group(seeds.agent, begins.train_episodes)].append(seed)
    groups = {group: tuple(seeds) for group, seeds in missing.items()}
    return planning.plan(groups, launch.workers, _episodes(launch.request))


def _other_code(launch: Launch, agents: Iterable[AgentSeeds]) -> Iterator[str]:
    """Warns of runs that other code began than is to go on with them."""
    now = manifest.commit()
    for task in sorted({seeds.agent.task for seeds in agents if seeds.interrupted}):
        then = (manifest.read(launch.folders[task].manifest) or {}).get("commit")
        if then and now and then != now:
            yield (
                f"warning: {task}: begun with commit {then} and resumed with {now}; the rest may "
                f"differ from what {then} would have given (the manifest has both)"
            )


def _doubts(launch: Launch, jobs: Sequence[Job]) -> list[str]:
    """What a person should know before jobs begin that may lack memory or disk.

    Raises:
      CommandError: they cannot but lack it.
    """
    return needs.doubts(
        jobs,
        launch.workers,
        _size_of(launch.request),
        launch.request.out,
        kept=needs.replaced(jobs, launch.folders),
        keep_final=launch.request.keep_final,
        here=launch.cluster is None,
    )


def need(request: Request) -> needs.Need:
    """What all that a request asks for takes on this machine, from the start to the end."""
    agents = [Agent(task, layers) for task in request.tasks for layers in request.subgoal_layers]
    workers = request.workers or manifest.cores()
    groups = {planning.Group(agent): request.seeds for agent in agents}
    jobs = planning.plan(groups, workers, _episodes(request))
    return needs.of_jobs(jobs, workers, _size_of(request), keep_final=request.keep_final)


def _size_of(request: Request) -> Callable[[Job], needs.Size]:
    """A function that returns how large each seed of a job is at its end."""
    # Rounds of training and tests take turns in the same environments.
    most = max(request.config.episodes_per_round, request.config.test_episodes)

    def size_of(job: Job) -> needs.Size:
        task, layers = tasks.find(job.agent.task), job.agent.subgoal_layers
        spec = task.spec
        attempts = hac_suite.horizons(spec.max_steps, layers, {**spec.horizons, **request.attempts})
        state = needs.of_seed(
            spec, attempts, request.config, max_steps=spec.max_steps, episodes=job.stop
        )
        return needs.Size(state, most * task.copy_bytes)

    return size_of


def _prepare(launch: Launch, recorder: Recorder, agents: Iterable[AgentSeeds]) -> None:
    """Says where all seeds stand, and readies the folders."""
    runs: dict[str, dict[tuple[int, int], list]] = {task: {} for task in launch.folders}
    for seeds in agents:
        task, layers = seeds.agent
        late = _not_kept(launch.folders[task], seeds, launch.request)
        for line in (*seeds.warnings, *_said(seeds, launch.request), *late):
            launch.say(line)
        if not launch.request.keep_final:
            launch.folders[task].drop_checkpoints((layers, seed) for seed in seeds.finished)
        for seed, begins in seeds.missing(launch.request).items():
            runs[task][layers, seed] = begins.rows
    for task, own in runs.items():
        recorder.prepare(task, own)


def _episodes(request: Request) -> int:
    return request.periods * request.config.episodes_per_period


def _seeds(
    folder: RunFolder, agent: Agent, request: Request, interrupted: checkpointing.Interrupted
) -> AgentSeeds:
    finished, points = folder.finished(agent, request.periods), interrupted.points
    new = [seed for seed in request.seeds if seed not in finished and seed not in points]
    return AgentSeeds(
        agent,
        finished=tuple(seed for seed in request.seeds if seed in finished),
        interrupted=points,
        new=tuple(new),
        again=tuple(seed for seed in new if folder.has_policy(agent.subgoal_layers, seed)),
        warnings=interrupted.warnings,
    )


def _said(seeds: AgentSeeds, request: Request) -> list[str]:
    """What a person is told of seeds that do not simply start."""
    lines = []
    if seeds.finished:
        done = len(seeds.finished)
        lines.append(f"{seeds.agent}: {done} of {len(request.seeds)} seeds are finished already")
    if seeds.interrupted:
        episodes = sorted({point.train_episodes for point in seeds.interrupted.values()})
        lines.append(
            f"{seeds.agent}: {len(seeds.interrupted)} seed(s) resume from episode "
            + ", ".join(map(str, episodes))
        )
    if seeds.again:
        lines.append(
            f"{seeds.agent}: {len(seeds.again)} seed(s) have a policy but lack some of its rows; "
            "they are trained again from the start"
        )
    return lines


def _not_kept(folder: RunFolder, seeds: AgentSeeds, request: Request) -> Iterator[str]:
    """Says which policies of earlier test periods are asked for, but were not kept in time."""
    behind = dict.fromkeys(seeds.finished, request.periods + 1)
    behind |= {seed: len(own.rows) for seed, own in seeds.interrupted.items()}
    late = folder.unkept(seeds.agent.subgoal_layers, behind, request.keep_policies)
    if late:
        yield _NOT_KEPT.format(
            agent=seeds.agent,
            periods=", ".join(map(str, sorted({period for _, period in late}))),
            count=len({seed for seed, _ in late}),
        )


def _train(launch: Launch, recorder: Recorder, jobs: Sequence[Job], work) -> None:
    """Trains the jobs, here or on the cluster, and records what they tell."""
    if not jobs:
        return
    plans = {task: _plan(task, launch.request, recorder) for task in launch.folders}
    with Board(jobs, _episodes(launch.request), launch.console) as board:

        def poll() -> None:
            board.tick()
            recorder.tick()

        hooks = Hooks(
            log=lambda job: launch.folders[job.agent.task].log(job),
            on_message=functools.partial(recorder.receive, board),
            on_poll=poll,
        )
        train = functools.partial(work, plans=plans)
        if launch.cluster:
            again = functools.partial(
                lost_jobs.again, recorder=recorder, plans=plans, say=launch.say
            )
            launch.cluster.execute(jobs, train, hooks, stop=launch.stop, again=again)
        else:
            execute(jobs, train, hooks, stop=launch.stop, workers=launch.workers)


def _plan(task: str, request: Request, recorder: Recorder) -> worker.Plan:
    horizons = recorder.manifests[task]["horizons"]
    return worker.Plan(
        word=tasks.find(task).word,
        out=request.out.resolve(),
        config=settings.anywhere(request.config),
        horizons={layers: tuple(horizons[str(layers)]) for layers in request.subgoal_layers},
        periods=request.periods,
        device=request.device,
        keep_final=request.keep_final,
        kept=request.keep_policies,
    )


def _kept(folder: RunFolder) -> Iterator[str]:
    """How much the states take that are kept for more periods."""
    size = folder.checkpoint_bytes()
    if size:
        yield (
            f"{folder.checkpoints}: {needs.told(size)}, which allow more --periods later; "
            "--keep_final=false keeps none"
        )


def _conclude(launch: Launch, recorder: Recorder) -> int:
    """Prints how it ended; returns the exit status."""
    if launch.stop.number is not None:
        launch.say("stopped; finished runs are kept, and the same command resumes")
        return 128 + launch.stop.number
    for folder in launch.folders.values():
        summary.summarise(folder, launch.console)
        for line in _kept(folder):
            launch.say(line)
    for job, reason in recorder.failures.items():
        launch.console.say(
            f"failed: {job.agent}, seeds {', '.join(map(str, job.seeds))}: {reason}\n"
            f"  see {launch.folders[job.agent.task].failure(job)}",
            style="red",
        )
    if recorder.failures:
        launch.say("the same command retries only what failed")
    return 1 if recorder.failures else 0
