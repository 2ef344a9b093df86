"""Files of films: what browsers need, and no more bytes than allowed."""

import av
import numpy as np
import pytest
from PIL import Image

from launch.films.files import TooLarge, write_animation, write_mp4


def frames(count: int = 24) -> list[np.ndarray]:
    """A square that moves over noise."""
    noise = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    made = []
    for index in range(count):
        frame = noise.copy()
        frame[20:60, 3 * index : 3 * index + 40] = (250, 200, 0)
        made.append(frame)
    return made


def test_an_mp4_begins_with_its_index_and_is_what_browsers_play(tmp_path):
    path = tmp_path / "film.mp4"
    write_mp4(iter(frames()), path)
    data = path.read_bytes()
    assert 0 < data.index(b"moov") < data.index(b"mdat")
    with av.open(path) as file:
        stream = file.streams.video[0]
        assert (stream.codec_context.name, stream.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height) == (128, 96)
        assert sum(1 for _ in file.decode(stream)) == 24


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_an_animation_moves_without_end_and_keeps_to_its_size(tmp_path, suffix):
    path = tmp_path / f"film{suffix}"
    write_animation(frames(), path, 10_000_000)
    with Image.open(path) as film:
        assert film.n_frames == 24 and film.info.get("loop") == 0
        film.seek(20)
        later = np.asarray(film.convert("RGB")).astype(int)
    assert np.abs(later[40, 80] - (250, 200, 0)).max() < 60
    good = path.stat().st_size
    write_animation(frames(), path, good - 1)
    assert path.stat().st_size < good


def test_what_cannot_be_made_so_small_says_what_to_do(tmp_path):
    with pytest.raises(TooLarge, match=r"it needs at least .* MB; .* --size"):
        write_animation(frames(), tmp_path / "film.webp", 100)
