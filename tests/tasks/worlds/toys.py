"""Gymnasium environments as strangers write them, each with a habit of its own."""

import random

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

RADIUS = 0.1


class Point(gymnasium.Env):
    """A point is pushed about a square. The goal is a place, and a ball of RADIUS around it."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012
    made = 0  # copies of all toys so far

    def __init__(
        self,
        *,
        terminates: bool = False,
        goal_speed: float = 0.0,
        draws: str = "own",
        dtype: type = np.float64,
        reward: str = "sparse",
        fails_above: float = np.inf,
        told_where: bool = True,
        nan_at: int | None = None,
        truncates_at: int | None = None,
        speed: float = 0.2,
        start: tuple[float, float] | None = None,
        render_mode: str | None = None,
    ):
        """Habits.

        Args:
          terminates: the episode ends at the goal.
          goal_speed: how far the goal goes with each step.
          draws: from where: own (the seed's), global, or system (no seed decides it).
          reward: sparse, scalar (for one pair at a time), column (for each pair a list of one),
            dense, always (the same), or info (which it needs).
          fails_above: the episode ends, in failure, with x above this.
          told_where: the observation has the position, and not only the velocity.
          nan_at, truncates_at: steps at which that happens.
        """
        type(self).made += 1
        self.render_mode, self.told_where, self.dtype = render_mode, told_where, dtype
        self.terminates, self.goal_speed, self.draws, self.reward = (
            terminates, goal_speed, draws, reward
        )  # fmt: skip
        self.fails_above, self.nan_at, self.truncates_at = fails_above, nan_at, truncates_at
        self.speed, self.start = speed, start
        self.action_space = Box(-2.0, 2.0, (2,), np.float32)
        place = Box(-np.inf, np.inf, (2,), dtype)
        size = 4 if told_where else 2
        self.observation_space = Dict(
            observation=Box(-np.inf, np.inf, (size,), dtype),
            achieved_goal=place,
            desired_goal=place,
        )

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        self.position = np.array(self.start or self._draw(), float)
        self.goal = np.array((options or {}).get("goal", self._draw()), float)
        self.velocity = np.zeros(2)
        return self._seen(), {}

    def _draw(self):
        if self.draws == "own":
            return self.np_random.uniform(-1, 1, 2)
        if self.draws == "global":
            return np.array([np.random.uniform(-1, 1), random.uniform(-1, 1)])
        return np.random.default_rng().uniform(-1, 1, 2)

    def step(self, action):
        assert action.dtype == np.float32 and action.shape == (2,)
        self.steps += 1
        self.velocity = 0.5 * self.velocity + self.speed * action / 4
        if self.draws == "global":
            self.velocity = self.velocity + np.random.normal(0, 0.01, 2)
        self.position = np.clip(self.position + self.velocity, -1, 1)
        self.goal = self.goal + self.goal_speed
        if self.steps == self.nan_at:
            self.position = np.full(2, np.nan)
        achieved = np.linalg.norm(self.position - self.goal) <= RADIUS
        terminated = bool(self.terminates and achieved) or self.position[0] > self.fails_above
        reward = 0.0 if achieved else -1.0
        return self._seen(), reward, terminated, self.steps == self.truncates_at, {}

    def _seen(self):
        parts = [self.position, self.velocity] if self.told_where else [self.velocity]
        return {
            "observation": np.concatenate(parts).astype(self.dtype),
            "achieved_goal": self.position.astype(self.dtype),
            "desired_goal": self.goal.astype(self.dtype),
        }

    def compute_reward(self, achieved_goal, desired_goal, info):
        if self.reward == "info":
            return info["reward"]
        if self.reward == "always":
            return 0.0
        distance = np.linalg.norm(achieved_goal - desired_goal, axis=-1)
        if self.reward == "column":
            return np.where(distance <= RADIUS, [1.0], [0.0])[..., None]
        if self.reward == "dense":
            return -distance
        if self.reward == "scalar":
            return 0.0 if distance <= RADIUS else -1.0
        return -(distance > RADIUS).astype(np.float32)

    def render(self):
        picture = np.zeros((20, 40, 3), np.uint8)
        picture[:, : int(20 * (self.position[0] + 1)) + 1] = 255
        return picture


class Nested(Point):
    """Its observation is a dictionary itself, of single precision; its goals are a 2 x 1 table."""

    def __init__(self, **habits):
        super().__init__(dtype=np.float32, **habits)
        inner = Dict(
            position=Box(-np.inf, np.inf, (2,), np.float32), on=Discrete(3),
            velocity=Box(-np.inf, np.inf, (2, 1), np.float32),
        )  # fmt: skip
        place = Box(-np.inf, np.inf, (2, 1), np.float32)
        self.observation_space = Dict(observation=inner, achieved_goal=place, desired_goal=place)

    def _seen(self):
        flat = super()._seen()
        position, velocity = np.split(flat["observation"], 2)
        inner = {"position": position, "on": 1, "velocity": velocity[:, None]}
        goals = {key: flat[key][:, None] for key in ("achieved_goal", "desired_goal")}
        return {"observation": inner, **goals}

    def compute_reward(self, achieved_goal, desired_goal, info):
        assert achieved_goal.dtype == np.float32
        assert achieved_goal.shape[-2:] == (2, 1)
        return super().compute_reward(achieved_goal[..., 0], desired_goal[..., 0], info)


class Cells(Point):
    """Its goals are cells of a board of 10 by 10, as whole numbers."""

    def __init__(self, **habits):
        super().__init__(**habits)
        cell = Box(0, 9, (2,), np.int64)
        self.observation_space = Dict(
            observation=self.observation_space["observation"], achieved_goal=cell, desired_goal=cell
        )

    def _seen(self):
        seen = super()._seen()
        cells = {key: np.clip(5 * seen[key] + 5, 0, 9).astype(int) for key in seen}
        return {**cells, "observation": seen["observation"]}

    def compute_reward(self, achieved_goal, desired_goal, info):
        assert np.issubdtype(achieved_goal.dtype, np.integer)
        return (achieved_goal == desired_goal).all(axis=-1) - 1.0


class Shared(Point):
    """Keeps where it is in the class, so that copies of it are one."""

    def __setattr__(self, name, value):
        if name in ("position", "velocity"):
            setattr(type(self), name, value)
        else:
            super().__setattr__(name, value)


class OddGoals(Point):
    """Goals that cannot be compared.

    `kind`: dict (they are dictionaries), more (it achieves more than it is asked for), less (its
    goals have fewer numbers than it declares), or unjudged (there is no compute_reward).
    """

    def __init__(self, kind: str, **habits):
        super().__init__(**habits)
        self.kind = kind
        if kind == "unjudged":
            self.compute_reward = None
        if kind in ("unjudged", "less"):
            return
        place, size = self.observation_space["desired_goal"], 2 if kind == "dict" else 3
        achieved = Box(-np.inf, np.inf, (size,))
        if kind == "dict":
            place = achieved = Dict(place=place)
        self.observation_space = Dict(
            observation=self.observation_space["observation"],
            achieved_goal=achieved,
            desired_goal=place,
        )

    def _seen(self):
        seen = super()._seen()
        goals = ("achieved_goal", "desired_goal") if self.kind == "less" else ()
        return {key: value[:1] if key in goals else value for key, value in seen.items()}


class Remembers(Point):
    """Shows where any copy of it was at last, also in the episode before."""

    last = 0.0

    def _seen(self):
        seen = super()._seen()
        seen["observation"][2] = type(self).last
        type(self).last = float(self.position[0])
        return seen


class OldApi(Point):
    """Returns what environments of gym 0.21 do, and says that it renders without being asked."""

    def __init__(self):
        super().__init__()

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)[0]


class Plain(gymnasium.Env):
    """No goals: a box of so many numbers. `actions`: box, discrete or unbounded."""

    def __init__(self, actions: str = "box", size: int = 3, render_mode: str | None = None):
        kinds = {
            "box": Box(-1.0, 1.0, (1,)), "discrete": Discrete(3),
            "unbounded": Box(-np.inf, np.inf, (1,)),
        }  # fmt: skip
        self.action_space = kinds[actions]
        self.observation_space = Box(-np.inf, np.inf, (size,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = np.array([self.np_random.uniform(-1, 1), 5.0, 0.0], np.float32)
        return self.state.copy(), {}

    def step(self, action):
        self.state[0] += 0.1 * action[0]
        self.state[2] += 1
        return self.state.copy(), 0.0, False, False, {}


gymnasium.register("HacToy/Point-v0", Point, max_episode_steps=30)
gymnasium.register("HacToy/PointForEver-v0", Point)
gymnasium.register("HacToy/Nested-v0", Nested, max_episode_steps=30)
gymnasium.register("HacToy/OldApi-v0", OldApi, max_episode_steps=30)
gymnasium.register("HacToy/Plain-v0", Plain, max_episode_steps=30)
