"""The cartpole: where "below the marker" is."""

import pytest

import tasks


def test_below_the_marker_is_where_cart_and_marker_overlap():
    env = tasks.load("cartpole_swingup", seed=0)
    env.reset()
    size = env.physics.named.model.geom_size
    reach = size["cartpole/cart", 0] + size["goal/shape", 0]
    space = env.task.spec.goal_space
    goal = [0.0, 2.2, 0.0, 0.0]
    assert space.threshold[-1] == pytest.approx(reach)
    assert space.achieved([0.0, 2.2, 0.0, 0.99 * reach], goal)
    assert not space.achieved([0.0, 2.2, 0.0, 1.01 * reach], goal)
