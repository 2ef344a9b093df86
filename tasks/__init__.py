"""Goal-conditioned MuJoCo tasks.

`load` gives a task as a Composer environment and `load_vector` as many environments stepped
together; importing the package registers every task with Gymnasium as "HACSuite/<Name>-v0".
"""

from tasks import to_gymnasium
from tasks.goal_space import GoalSpace
from tasks.loading import ALL, TAGS, load, load_vector
from tasks.vector import VectorEnv, VectorStep

__all__ = ["ALL", "TAGS", "GoalSpace", "VectorEnv", "VectorStep", "load", "load_vector"]

to_gymnasium.register_all(ALL)
