"""Goal-conditioned MuJoCo tasks.

`spec` describes a task, `load` makes a Composer environment and `load_vector` many environments
stepped together; `find` returns all three for a name. Importing the package registers every task
with Gymnasium as "HACSuite/<Name>-v0".
"""

import warnings

with warnings.catch_warnings():
    # Without a display dm_control asks GLFW for one before it takes another backend.
    warnings.filterwarnings("ignore", message=r".*DISPLAY environment variable is missing")
    import dm_control.mujoco  # noqa: F401

from tasks import to_gymnasium
from tasks.finding import ALL, find, load, load_vector, spec, unfitted
from tasks.goal_space import GoalSpace
from tasks.task_spec import TaskSpec
from tasks.vector import VectorEnv, VectorStep
from tasks.worlds.fitted import Unfitted
from tasks.worlds.words import compose as gym_word
from tasks.worlds.world import from_gymnasium

__all__ = [
    "ALL",
    "GoalSpace",
    "TaskSpec",
    "Unfitted",
    "VectorEnv",
    "VectorStep",
    "find",
    "from_gymnasium",
    "gym_word",
    "load",
    "load_vector",
    "spec",
    "unfitted",
]

to_gymnasium.register_all(ALL)
