"""Views and lenses: a point is drawn where it is rendered, and all that happens is in sight."""

import numpy as np
import pytest

from analysis.program import CommandError
from launch.drawing.lens import Lens
from launch.drawing.view import View, placed, points_of_interest

SIZE = (480, 320)


@pytest.fixture
def view(course) -> View:
    found = View(course.stage, None, SIZE)
    found.frame(points_of_interest(course))
    return found


@pytest.mark.parametrize("camera", [None, "side"])
def test_all_that_happens_is_framed_and_fills_the_picture(course, camera):
    view = View(course.stage, camera, SIZE)
    points = points_of_interest(course)
    view.frame(points)
    pixels = view.pixels(points)
    low, high = pixels.min(0), pixels.max(0)
    assert (low > 0.05 * np.array(SIZE)).all() and (high < 0.95 * np.array(SIZE)).all()
    assert ((high - low) / SIZE).max() == pytest.approx(0.76, abs=0.02)
    assert np.diff(view.bounds, axis=0)[0] == pytest.approx(
        np.diff(view.bounds, axis=0)[0, 1] * np.array([SIZE[0] / SIZE[1], 1])
    )


def test_another_camera_is_named(course):
    with pytest.raises(CommandError, match="flag --camera: unknown camera 'sid': did you mean"):
        View(course.stage, "sid", SIZE)


@pytest.mark.requires_gl
def test_bodies_are_rendered_where_points_are_drawn(course, view):
    """The blue rod's pixels are within the outline of its projected shape."""
    lens = Lens(course, view)
    picture = lens.picture(0).astype(int)
    lens.close()
    (shape,) = [shape for shape in course.stage.shapes if np.argmax(shape.rgba[:3]) == 2
                and shape.rgba[2] > 0.8]  # fmt: skip
    pixels = view.pixels(placed(shape.vertices, course.poses[0], shape.body))
    blue = (picture[..., 2] > 150) & (picture[..., 0] < 90)
    rows, columns = np.nonzero(blue)
    assert len(rows) > 50
    assert np.abs([columns.min(), rows.min()] - pixels.min(0)).max() < 4
    assert np.abs([columns.max(), rows.max()] - pixels.max(0)).max() < 4


@pytest.mark.requires_gl
def test_a_part_that_is_rendered_anew_fits_what_is_around_it(course, view, monkeypatch):
    lens = Lens(course, view)
    quick = lens.picture(30.0)
    monkeypatch.setattr(lens, "_where", lambda: (0, 0, *SIZE))
    whole = lens.picture(30.0)
    lens.close()
    differing = np.abs(quick.astype(int) - whole).max(-1) > 24
    assert differing.mean() < 0.001


@pytest.mark.requires_gl
def test_between_two_steps_bodies_are_on_their_way(course, view):
    lens = Lens(course, view)
    before, middle, after = (lens.picture(moment).astype(int) for moment in (20, 20.5, 21))
    np.testing.assert_array_equal(lens.picture(20), before)
    lens.close()
    assert (middle != before).any() and (middle != after).any()
    names = [course.stage.model.joint(i).name for i in range(course.stage.model.njnt)]
    assert names  # and of each joint, halfway: the state that is rendered
    lens = Lens(course, view)
    lens._place(20.5)
    nq = course.stage.model.nq
    np.testing.assert_allclose(
        lens._data.qpos, (course.states[20][:nq] + course.states[21][:nq]) / 2, atol=1e-6
    )
    lens.close()
