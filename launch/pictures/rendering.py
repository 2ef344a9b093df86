"""Renders test episodes in this process, whose MUJOCO_GL is set: run by `launch.pictures.video`.

MUJOCO_GL=egl python -m launch.pictures.rendering '{"policies": [...], "output": ...}'
"""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import imageio.v3 as iio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import hac_suite
import tasks
from analysis import program
from analysis.reading import paper
from analysis.reading.files import write_atomically
from hac_suite.algorithm import exploration
from launch.asking import settings, start
from launch.pictures import video

_MOST_FRAMES_PER_SECOND = 30
_STEPS_PER_FRAME = 2
SIZE = (640, 480)  # width, height of the picture below the title
_TITLE_HEIGHT = 56
_HOLD_FRAMES = 45
_STRIP_FRAMES = 6
_STRIP_SCALE = 2  # frames of a strip are this many times smaller

Show = Callable[[np.ndarray], None]  # takes a frame: uint8 [height, width, 3]


class Choice(NamedTuple):
    """What is shown: a policy, and the seeds of its episodes."""

    policy: hac_suite.Policy
    episodes: list[int]


def main(argument: str) -> None:
    """Writes what the JSON object `argument` asks for; without policies, only tries to render.

    Raises:
      SystemExit: with videos.BAD_POLICY, after a line that says what is wrong with a policy.
    """
    request = json.loads(argument)
    if not request:
        _probe()
        return
    if request.get("task"):
        tasks.find(request["task"])
    output = Path(request["output"])
    strip = output.suffix == ".png"
    try:
        choice = choose(request["policies"], 1 if strip else request["episodes"])
    except (
        program.CommandError,
        KeyError,
        TypeError,
        ValueError,
    ) as error:  # nothing is rendered yet
        what = f"lacks the entry {error}" if isinstance(error, KeyError) else str(error)
        print(f"policy: {what}", file=sys.stderr)
        sys.exit(video.BAD_POLICY)
    output.parent.mkdir(parents=True, exist_ok=True)
    write = write_strip if strip else write_video
    write_atomically(output, lambda path: write(choice, path))


def choose(paths: Sequence[str], count: int) -> Choice:
    """The first of these policies that succeeds in a test episode, else the first; its episodes.

    Raises:
      CommandError, KeyError, TypeError, ValueError: a policy cannot be loaded or run.
    """
    choices = []
    for path in paths:
        policy = hac_suite.Policy.load(path)
        seeds, success = _test_episodes(policy, count)
        order = np.argsort(~success, kind="stable")  # successes first
        choices.append(Choice(policy, [int(seed) for seed in seeds[order][:count]]))
        if success.any():
            return choices[-1]
    return choices[0]


def _test_episodes(policy: hac_suite.Policy, least: int) -> tuple[np.ndarray, np.ndarray]:
    """Seeds of the episodes of every test period of the policy's seed, and its success in them."""
    config = _config(policy)
    seeds = exploration.episode_seeds(
        policy.metadata["seed"],
        exploration.Purpose.TEST_EPISODE,
        0,
        max(config.test_episodes, least),
    )
    env = tasks.load_vector(policy.metadata["task"], len(seeds))
    stats = hac_suite.run_episodes(env, policy, seeds, config=config)
    env.close()
    return seeds, stats.success


def write_video(choice: Choice, path: Path) -> None:
    """An mp4 of test episodes, H.264 in yuv420p, which browsers and players open."""
    with iio.imopen(path, "w", plugin="pyav") as file:
        fps = frames_per_second(choice.policy.metadata["task"])
        file.init_video_stream("libx264", fps=fps, pixel_format="yuv420p")
        for index, seed in enumerate(choice.episodes, start=1):
            label = f"episode {index} of {len(choice.episodes)}"
            film_episode(choice.policy, seed, label, file.write_frame)


def write_strip(choice: Choice, path: Path) -> None:
    """A png of one episode: frames side by side, evenly spaced from its start to its end."""
    frames: list[np.ndarray] = []
    film_episode(
        choice.policy,
        choice.episodes[0],
        "",
        lambda frame: frames.append(np.asarray(Image.fromarray(frame).reduce(_STRIP_SCALE))),
    )
    last = len(frames) - _HOLD_FRAMES  # the first of those that hold the end
    shown = np.linspace(0, last, _STRIP_FRAMES).round().astype(int)
    iio.imwrite(path, np.concatenate([frames[i] for i in shown], axis=1))


def film_episode(policy: hac_suite.Policy, seed: int, label: str, show: Show) -> None:
    """Shows every second step of a test episode, and its end for a moment longer."""
    task, config = policy.metadata["task"], _config(policy)
    env = tasks.load_vector(task, 1)
    agent = paper.agent_name(policy.subgoal_layers)
    who = f"{task}   {agent}   seed {policy.metadata['seed']}   {label}"

    def on_step(view: hac_suite.StepView) -> None:
        if view.subgoals:
            env.show_subgoals(0, [subgoal[0] for subgoal in view.subgoals])
        if view.step % _STEPS_PER_FRAME == 0:
            picture = env.render(0, width=SIZE[0], height=SIZE[1])
            show(titled(picture, who, counts(view, env.max_steps, policy.horizons, config)))

    stats = hac_suite.run_episodes(env, policy, np.array([seed]), config=config, on_step=on_step)
    outcome = "goal reached in" if stats.success[0] else "goal not reached in"
    picture = env.render(0, width=SIZE[0], height=SIZE[1])
    env.close()
    for _ in range(_HOLD_FRAMES):
        show(titled(picture, who, f"{outcome} {stats.steps[0]} steps"))


def frames_per_second(task: str) -> int:
    """As many as play in real time; where screens do not show so many, at down to half speed."""
    seconds = tasks.spec(task).control_timestep
    return min(_MOST_FRAMES_PER_SECOND, round(1 / (_STEPS_PER_FRAME * seconds)))


def titled(picture: np.ndarray, first: str, second: str) -> np.ndarray:
    """The picture, uint8 [height, width, 3], under a strip with two lines of text."""
    strip = Image.new("RGB", (picture.shape[1], _TITLE_HEIGHT), (24, 24, 28))
    draw = ImageDraw.Draw(strip)
    font = ImageFont.load_default(size=17)
    draw.text((12, 6), first, font=font, fill=(255, 255, 255))
    draw.text((12, 30), second, font=font, fill=(200, 200, 205))
    return np.concatenate([np.asarray(strip), picture])


def counts(
    view: hac_suite.StepView,
    max_steps: int,
    horizons: tuple[int, ...],
    config: hac_suite.Config,
) -> str:
    """Steps and attempts made, with the bounds that hold in tests."""
    top = len(horizons) - 1
    attempts = [
        f"level {level}: {int(made[0])}"
        + ("" if level == top and config.test_until_horizon else f"/{allowed}")
        for level, (made, allowed) in enumerate(zip(view.attempts, horizons, strict=True))
    ]
    return f"step {view.step}/{max_steps}   attempts at {',  '.join(attempts)}"


def _config(policy: hac_suite.Policy) -> hac_suite.Config:
    return settings.to_config(policy.metadata["config"])


def _probe() -> None:
    """Renders one frame, to find out whether this backend works."""
    env = tasks.load_vector(tasks.ALL[0], 1)
    env.reset(np.array([0]))
    picture = env.render(0, width=64, height=48)
    env.close()
    if not picture.any():
        raise RuntimeError("the rendered frame is black")


if __name__ == "__main__":
    start.die_with_the_parent()
    main(sys.argv[1])
