"""A Gymnasium environment whose goals and subgoals are places on a line: of one dimension."""

import gymnasium
import numpy as np

WORD, TASK = "gym:tests.launch.line:Line-v0", "Line-v0"


class Line(gymnasium.Env):
    """That of docs/your_own_environment.md."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))
    _place = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    observation_space = gymnasium.spaces.Dict(
        observation=_place, achieved_goal=_place, desired_goal=_place
    )

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.goal = self.np_random.uniform(-1, 1, (2, 1))
        return self._look(), {}

    def step(self, action):
        self.x = np.clip(self.x + 0.1 * action, -1, 1)
        return self._look(), 0.0, False, False, {}

    def _look(self):
        return {"observation": self.x, "achieved_goal": self.x, "desired_goal": self.goal}

    def compute_reward(self, achieved_goal, desired_goal, info):
        return -(np.abs(achieved_goal - desired_goal)[..., 0] > 0.05).astype(float)


gymnasium.register(TASK, entry_point=Line, max_episode_steps=25)
