"""Our tasks as Gymnasium goal environments, single and vectorised."""

from collections.abc import Iterable

import gymnasium

from tasks import finding
from tasks.to_gymnasium.env import GoalEnv
from tasks.to_gymnasium.vector_env import GoalVectorEnv

__all__ = ["GoalEnv", "GoalVectorEnv", "environment_id", "register_all"]

_NAMESPACE = "HACSuite"
_VERSION = "v0"
_ACRONYMS = {"ur5": "UR5"}  # words of task names that are not capitalised like others


def environment_id(name: str) -> str:
    """The Gymnasium id of a task: "pick_place" is "HACSuite/PickPlace-v0"."""
    words = "".join(_ACRONYMS.get(word, word.capitalize()) for word in name.split("_"))
    return f"{_NAMESPACE}/{words}-{_VERSION}"


def register_all(names: Iterable[str]) -> None:
    """Registers the tasks of these names with Gymnasium."""
    for name in names:
        gymnasium.register(
            id=environment_id(name),
            entry_point="tasks.to_gymnasium:GoalEnv",
            vector_entry_point="tasks.to_gymnasium:GoalVectorEnv",
            max_episode_steps=finding.spec(name).max_steps,
            kwargs={"name": name},
        )
