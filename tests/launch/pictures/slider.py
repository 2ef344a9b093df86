"""A Gymnasium environment that MuJoCo simulates, with what makes others' hard to draw."""

import gymnasium
import mujoco
import numpy as np
import torch

import hac_suite
import tasks
from hac_suite.learning.networks import StackedMLP
from hac_suite.types import level_specs
from launch.asking import settings

WORD = "gym:tests.launch.pictures.slider:HacToy/{}-v0"
_STEPS = 6
_XML = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="3 3 0.1" rgba="0.4 0.4 0.4 1"/>
    <site name="target" size="0.05" rgba="1 1 0 1"/>
    <body name="handle" mocap="true" pos="0 0 0.6">
      <geom type="box" size="0.02 0.02 0.02" contype="0" conaffinity="0"/>
      <site size="0.06" rgba="0 1 0 1"/>
    </body>
    <body name="cart" pos="0 0 0.2">
      <joint name="x" type="slide" axis="1 0 0"/>
      <camera name="eye" pos="0 0 0.2"/>
      <geom type="box" size="0.1 0.1 0.1" mass="1" rgba="0 0 1 1"/>
      <site name="flag" pos="0 0 0.4" size="0.08" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


class Slider(gymnasium.Env):
    """A cart is moved along a line; a site marks the place where it is to go.

    A mocap body is the cart's handle, as in Fetch, and the only camera rides on the cart.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))
    _place = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    observation_space = gymnasium.spaces.Dict(
        observation=_place, achieved_goal=_place, desired_goal=_place
    )

    def __init__(self, render_mode: str | None = None):
        self.render_mode = render_mode
        self.model = mujoco.MjModel.from_xml_string(_XML)
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        x, goal = self.np_random.uniform((-1.0, 1.0), (-0.5, 1.5))
        self.goal = np.array([goal])
        self._move(x)
        return self._look(), {}

    def step(self, action):
        self._move(np.clip(self.data.qpos[0] + 0.1 * action[0], -1, 0.5))
        return self._look(), 0.0, False, False, {}

    def _move(self, x):
        self.data.qpos[:] = x
        self.data.mocap_pos[0] = x, 0, 0.6
        mujoco.mj_forward(self.model, self.data)

    def _look(self):
        place = self.data.qpos.copy()
        return {"observation": place, "achieved_goal": place, "desired_goal": self.goal.copy()}

    def compute_reward(self, achieved_goal, desired_goal, info):
        return -(np.abs(achieved_goal - desired_goal)[..., 0] > 0.05).astype(float)

    def _mark_the_goal(self):
        self.model.site("target").pos[0] = self.goal[0]

    def render(self):
        """All of one grey; as in Fetch, it is here that the goal's marker is put in place."""
        self._mark_the_goal()
        return np.full((64, 64, 3), 200, np.uint8)


class Undrawn(Slider):
    """It marks its goal when it begins, and draws no pictures."""

    metadata = {"render_modes": []}  # noqa: RUF012

    def reset(self, *, seed=None, options=None):
        start = super().reset(seed=seed)
        self._mark_the_goal()
        return start

    def render(self):
        raise NotImplementedError


for _kind in (Slider, Undrawn):
    gymnasium.register(f"HacToy/{_kind.__name__}-v0", _kind, max_episode_steps=_STEPS)


def policy(kind: type[Slider]) -> hac_suite.Policy:
    """An untrained one with a subgoal layer."""
    task = tasks.find(WORD.format(kind.__name__))
    networks, generator = [], torch.Generator().manual_seed(0)
    for level in level_specs(task.spec, (3, 2)):
        sizes = (level.observation_dim + level.goal_space.dim, 8, level.action_dim)
        networks.append(StackedMLP(1, sizes))
        networks[-1].initialise(0, generator)
    config = settings.as_json(hac_suite.Config(hidden_sizes=(8,)))
    return hac_suite.Policy(networks, (3, 2), {"task": task.word, "seed": 0, "config": config})
