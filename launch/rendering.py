"""Renders test episodes in this process, whose MUJOCO_GL is set: run by `launch.videos`.

MUJOCO_GL=egl python -m launch.rendering '{"policy": ..., "output": ..., "episodes": 2}'
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import hac_suite
import tasks
from launch import settings

FRAMES_PER_SECOND = 30
_STEPS_PER_FRAME = 2  # with control steps of 0.0125 to 0.03 s: real time, or up to twice as slow
SIZE = (640, 480)  # width, height of the picture below the title
_TITLE_HEIGHT = 56
_HOLD_FRAMES = 45
_CANDIDATES = 16  # episodes to find successes among
_STRIP_FRAMES = 6
_STRIP_SCALE = 2  # frames of a strip are this many times smaller

Show = Callable[[np.ndarray], None]  # takes a frame: uint8 [height, width, 3]


def main(argument: str) -> None:
    """Writes what the JSON object `argument` asks for; without a policy, only tries to render."""
    request = json.loads(argument)
    if not request:
        _probe()
        return
    policy = hac_suite.Policy.load(request["policy"])
    output = Path(request["output"])
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(f".{output.stem}.{os.getpid()}{output.suffix}")
    try:
        if output.suffix == ".png":
            write_strip(policy, temporary)
        else:
            write_video(policy, temporary, request["episodes"])
        os.replace(temporary, output)
    finally:
        temporary.unlink(missing_ok=True)


def write_video(policy: hac_suite.Policy, path: Path, episodes: int) -> None:
    """An mp4 of `episodes` test episodes, H.264 in yuv420p, which browsers and players open."""
    with iio.imopen(path, "w", plugin="pyav") as file:
        file.init_video_stream("libx264", fps=FRAMES_PER_SECOND, pixel_format="yuv420p")
        for index, seed in enumerate(choose_episodes(policy, episodes), start=1):
            label = f"episode {index} of {episodes}"
            film_episode(policy, seed, label, file.write_frame)


def write_strip(policy: hac_suite.Policy, path: Path) -> None:
    """A png of one episode: frames side by side, evenly spaced from its start to its end."""
    frames: list[np.ndarray] = []
    film_episode(
        policy,
        choose_episodes(policy, 1)[0],
        "",
        lambda frame: frames.append(np.asarray(Image.fromarray(frame).reduce(_STRIP_SCALE))),
    )
    last = len(frames) - _HOLD_FRAMES  # the first of those that hold the end
    shown = np.linspace(0, last, _STRIP_FRAMES).round().astype(int)
    iio.imwrite(path, np.concatenate([frames[i] for i in shown], axis=1))


def choose_episodes(policy: hac_suite.Policy, count: int) -> list[int]:
    """Seeds of `count` test episodes, those that reach the goal first."""
    candidates = np.arange(max(count, _CANDIDATES))
    env = tasks.load_vector(policy.metadata["task"], len(candidates))
    stats = hac_suite.run_episodes(env, policy, candidates, config=_config(policy))
    env.close()
    order = np.argsort(~stats.success, kind="stable")
    return [int(seed) for seed in candidates[order][:count]]


def film_episode(policy: hac_suite.Policy, seed: int, label: str, show: Show) -> None:
    """Shows every step of a test episode, and its end for a moment longer."""
    task = policy.metadata["task"]
    env = tasks.load_vector(task, 1)
    layers = policy.subgoal_layers
    plural = "" if layers == 1 else "s"
    who = f"{task}   {layers} subgoal layer{plural}   seed {policy.metadata['seed']}   {label}"

    def on_step(view: hac_suite.StepView) -> None:
        if view.subgoals:
            env.show_subgoals(0, [subgoal[0] for subgoal in view.subgoals])
        if view.step % _STEPS_PER_FRAME == 0:
            picture = env.render(0, width=SIZE[0], height=SIZE[1])
            show(titled(picture, who, _counts(view, env.max_steps, policy.horizons)))

    stats = hac_suite.run_episodes(
        env, policy, np.array([seed]), config=_config(policy), on_step=on_step
    )
    outcome = "goal reached in" if stats.success[0] else "goal not reached in"
    picture = env.render(0, width=SIZE[0], height=SIZE[1])
    env.close()
    for _ in range(_HOLD_FRAMES):
        show(titled(picture, who, f"{outcome} {stats.steps[0]} steps"))


def titled(picture: np.ndarray, first: str, second: str) -> np.ndarray:
    """The picture, uint8 [height, width, 3], under a strip with two lines of text."""
    strip = Image.new("RGB", (picture.shape[1], _TITLE_HEIGHT), (24, 24, 28))
    draw = ImageDraw.Draw(strip)
    font = ImageFont.load_default(size=17)
    draw.text((12, 6), first, font=font, fill=(255, 255, 255))
    draw.text((12, 30), second, font=font, fill=(200, 200, 205))
    return np.concatenate([np.asarray(strip), picture])


def _counts(view: hac_suite.StepView, max_steps: int, horizons: tuple[int, ...]) -> str:
    attempts = [
        f"level {level}: {int(made[0])}/{allowed}"
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
    main(sys.argv[1])
