"""What a policy's critics think of what it does: Q per level, to look at."""

from collections.abc import Sequence

import numpy as np
import torch

from hac_suite.config import Config
from hac_suite.learning.ddpg import DDPG, critic_kind
from hac_suite.learning.learner import Learner
from hac_suite.learning.networks import ALIGNED, StackedMLP
from hac_suite.policy import Policy
from hac_suite.types import LevelSpec


def critics_of(learners: Sequence[Learner]) -> list[StackedMLP]:
    """The networks whose Q the levels' actors ascend; none, if a level has another kind of critic.

    TD3's actor follows the first of its two.
    """
    found = [learner.critic for learner in learners if isinstance(learner, DDPG)]
    return found if len(found) == len(learners) else []


def q_values(
    policy: Policy,
    levels: Sequence[LevelSpec],
    config: Config,
    observation: np.ndarray,
    goals: Sequence[np.ndarray],
) -> list[np.ndarray]:
    """Q of what each level would do: per level [N], the lowest first.

    Args:
        levels: of the task that the policy was trained on.
        config: that it was trained with.
        observation: [N, D] in natural units.
        goals: per level what it pursues, [N, G_i].

    Returns:
        Nothing for a policy without critics.
    """
    if not policy.critics:
        return []
    found = []
    actors = policy.actors(levels)
    for critic, actor, spec, goal in zip(policy.critics, actors, levels, goals, strict=True):
        columns = [
            actor(observation, goal),
            spec.scaled(observation),
            spec.goal_space.normalise(goal),
            np.ones((len(observation), 1)),
        ]
        rows = np.concatenate(columns, axis=1).astype(np.float32)
        block = torch.zeros(1, rows.shape[1], len(rows) + -len(rows) % ALIGNED)
        block[0, :, : len(rows)] = torch.from_numpy(rows.T)
        value = critic_kind(spec, config).value(critic.forward(block)[:, 0])
        found.append(value[0, : len(rows)].numpy().copy())
    return found
