"""Loading tasks by name: as a Composer environment, or as many environments at once."""

from dm_control import composer

# Importing a task's module registers it; this order is the order of `ALL`.
# isort: off
from tasks import pendulum  # noqa: F401
from tasks import ur5_reacher  # noqa: F401
from tasks import cartpole  # noqa: F401
from tasks import pick_place  # noqa: F401


# isort: on
from tasks import registry
from tasks.vector import VectorEnv

ALL: tuple[str, ...] = tuple(registry.names())
TAGS: tuple[str, ...] = tuple(registry.tags())


def load(name: str, seed: int | None = None, *, test: bool = False) -> composer.Environment:
    """Loads a task as a Composer environment with the `dm_env` interface.

    Args:
      name: one of `ALL`.
      seed: decides all randomness of the environment; None takes one from the system.
      test: whether episodes begin from the test starts rather than the training starts.

    Raises:
      ValueError: unknown name; the message lists the names, the closest first.
    """
    return composer.Environment(
        registry.get(name)(test=test),
        random_state=seed,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
    )


def load_vector(name: str, num_envs: int, seed: int = 0) -> VectorEnv:
    """Loads a task as `num_envs` environments stepped together (see `tasks.vector`).

    Args:
      name: one of `ALL`.
      num_envs: how many environments, at least 1.
      seed: decides the episodes of resets that are given no seeds.

    Raises:
      ValueError: unknown name, or fewer than one environment.
    """
    return VectorEnv(load(name, seed=0), name, num_envs, seed)
