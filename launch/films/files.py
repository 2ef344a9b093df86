"""Writes films: mp4 that browsers play, and animated WebP and GIF of a bounded size."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import av
import numpy as np
from PIL import Image

from launch.drawing.pacing import FRAMES_PER_SECOND

_ENCODING = {"preset": "veryfast", "crf": "23"}  # x264's; crf 0 loses nothing
_LAST_SECONDS = 2.0  # that the last frame of an endless picture is shown for
_WEBP_QUALITIES = (80, 65, 50, 35, 20)
_GIF_COLOURS = (192, 96, 48, 24)


class TooLarge(ValueError):
    """A moving picture takes more bytes than it may; the message says what to do."""


def write_mp4(frames: Iterable[np.ndarray], path: Path) -> None:
    """H.264 in yuv420p, its index first: browsers play it at once.

    Args:
      frames: uint8 [height, width, 3], both even.
    """
    with av.open(path, "w", options={"movflags": "+faststart"}) as file:
        stream = None
        for frame in frames:
            if stream is None:
                stream = file.add_stream("libx264", FRAMES_PER_SECOND, options=_ENCODING)
                stream.height, stream.width = frame.shape[:2]
                stream.pix_fmt = "yuv420p"
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame)))
        if stream is not None:
            file.mux(stream.encode())


def write_animation(frames: Sequence[np.ndarray], path: Path, most_bytes: int) -> None:
    """A .webp or .gif that plays without end, as good as so many bytes allow.

    Raises:
      TooLarge: even the worst quality takes more.
    """
    gif = path.suffix == ".gif"
    for quality in _GIF_COLOURS if gif else _WEBP_QUALITIES:
        (_save_gif if gif else _save_webp)(frames, path, quality)
        if path.stat().st_size <= most_bytes:
            return
    size = path.stat().st_size / 1e6
    raise TooLarge(
        f"it needs at least {size:.1f} MB; make it smaller with --size, or shorter with --speed"
    )


def _durations(frames: Sequence[np.ndarray]) -> list[int]:
    """Milliseconds of each frame."""
    each = round(1000 / FRAMES_PER_SECOND)
    return [each] * (len(frames) - 1) + [round(1000 * _LAST_SECONDS)]


def _save_webp(frames: Sequence[np.ndarray], path: Path, quality: int) -> None:
    first, *rest = map(Image.fromarray, frames)
    first.save(path, "WEBP", save_all=True, append_images=rest, duration=_durations(frames),
               loop=0, quality=quality, method=4)  # fmt: skip


def _save_gif(frames: Sequence[np.ndarray], path: Path, colours: int) -> None:
    palette = Image.fromarray(frames[len(frames) // 2]).quantize(colours)
    first, *rest = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    first.save(path, "GIF", save_all=True, append_images=rest, duration=_durations(frames), loop=0)
