"""Policies: the goal-conditioned actors of a hierarchy, how they act and how they are saved."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hac_suite import policy_files
from hac_suite.acting import Episode
from hac_suite.learning.networks import ALIGNED, StackedMLP, in_whole_registers
from hac_suite.types import Actor, LevelSpec, Spaces, level_specs

_MOST_ATTEMPTS = 10**6  # of a level; what nobody means must not run for ever
_CRITIC = "critic."  # in the names of tensors


def as_actor(network: StackedMLP, spec: LevelSpec) -> Actor:
    """The actor of a level for S seeds: rows [S * E, ...] of a lock step, seed by seed."""
    seeds = network.parameters.shape[0]
    observations, width = spec.observation_dim, spec.observation_dim + spec.goal_space.dim
    inputs: dict[int, torch.Tensor] = {}

    def act(observation: np.ndarray, goal: np.ndarray) -> np.ndarray:
        rows = len(observation)
        if rows not in inputs:
            inputs[rows] = torch.ones(rows, width + ALIGNED - width % ALIGNED)
        block = inputs[rows].numpy()
        block[:, :observations] = spec.scaled(observation)
        block[:, observations:width] = spec.goal_space.normalise(goal)
        stacked = inputs[rows].view(seeds, rows // seeds, -1)[..., : width + 1]
        output = in_whole_registers(torch.tanh, network.forward(stacked.transpose(1, 2)))
        return output.transpose(1, 2).reshape(rows, -1).numpy()

    return act


class Policy:
    """One trained agent: the actors of all its levels, of one seed.

        policy = hac_suite.Policy.load("assets/policies/pick_place_2layers_seed3")
        policy.reset(tasks.spec("pick_place"))
        while ...:  # an episode
            action = policy.act(observation, goal, achieved_subgoal)

    Attributes:
        horizons: (T_0, ..., T_n).
        metadata: what the file said about itself (task, seed, score, ...).
        critics: per level the critic of its actor, for `hac_suite.values`; none in files saved
            without critics, or for learners with another kind of critic.
    """

    def __init__(
        self,
        networks: Sequence[StackedMLP],
        horizons: Sequence[int],
        metadata: dict[str, Any] | None = None,
        critics: Sequence[StackedMLP] = (),
    ):
        self.networks = list(networks)
        self.horizons = tuple(horizons)
        self.metadata = dict(metadata or {})
        self.critics = list(critics)
        self._episode: Episode | None = None

    @property
    def subgoal_layers(self) -> int:
        return len(self.horizons) - 1

    @classmethod
    def of_seed(
        cls,
        networks: Sequence[StackedMLP],
        seed: int,
        horizons: Sequence[int],
        critics: Sequence[StackedMLP] = (),
    ) -> "Policy":
        """A copy of one seed's actors, and of its critics."""
        own = [_of_seed(network, seed) for network in networks]
        return cls(own, horizons, critics=[_of_seed(critic, seed) for critic in critics])

    def actors(self, levels: Sequence[LevelSpec]) -> list[Actor]:
        """Callables for `hierarchy.collect`.

        Raises:
            ValueError: the environment's sizes are not those the policy was trained for.
        """
        for index, (network, spec) in enumerate(zip(self.networks, levels, strict=True)):
            wanted = (spec.observation_dim + spec.goal_space.dim, spec.action_dim)
            held = (network.sizes[0], network.outputs)
            if wanted != held:
                raise ValueError(
                    f"The policy's level {index} maps {held[0]} numbers to {held[1]}, but this "
                    f"task needs {wanted[0]} to {wanted[1]}: it was trained on another task."
                )
        return [as_actor(n, spec) for n, spec in zip(self.networks, levels, strict=True)]

    def reset(self, spec: Spaces) -> None:
        """Begins an episode; then call `act` for each action.

        Args:
            spec: the task's scales, spaces and bounds: `tasks.spec` or a `VectorEnv`.

        Raises:
            ValueError: the policy was trained on another task.
        """
        actors = self.actors(level_specs(spec, self.horizons))
        self._episode = Episode(spec, actors, self.horizons)

    def act(
        self,
        observation: np.ndarray,
        goal: np.ndarray,
        achieved_subgoal: np.ndarray | None = None,
    ) -> np.ndarray:
        """The next action of the episode, as in tests: without noise (Section 4.2).

        All are in natural units. The levels' subgoals and attempts are kept from one call to the
        next, so it is called once for each action, in order, until the episode ends.

        Args:
            observation: [D].
            goal: the end goal, [G].
            achieved_subgoal: the state in the subgoal space, [H]; an agent without subgoal layers
                needs none.

        Returns:
            [A], within the motors' bounds.

        Raises:
            ValueError: no episode has begun, or an argument is not what the task has.
        """
        if self._episode is None:
            raise ValueError("no episode has begun: call reset(tasks.spec(...)) before act")
        return self._episode.act(observation, goal, achieved_subgoal)

    def save(self, path: str | Path, metadata: dict[str, Any]) -> None:
        """Writes `path`.safetensors and `path`.json, over what is there.

        Args:
            metadata: what the description holds besides `horizons`, in JSON's types. The task's
                name, and the config that `q_values` needs, belong here.
        """
        tensors = {
            f"level{level}.{prefix}layer{layer}": weight[0, : _outputs(network, layer)].contiguous()
            for prefix, networks in (("", self.networks), (_CRITIC, self.critics))
            for level, network in enumerate(networks)
            for layer, weight in enumerate(network.weights)
        }
        description = {**metadata, "horizons": list(self.horizons)}
        policy_files.write(Path(path), tensors, description)

    @classmethod
    def load(cls, path: str | Path) -> "Policy":
        """Reads what `save` wrote; nothing in the files is executed.

        Raises:
            ValueError: a file is missing, damaged, or not a policy; the message names it.
        """
        tensors_path, json_path = policy_files.paths(Path(path))
        metadata = policy_files.describe(json_path)
        tensors = policy_files.tensors(tensors_path)
        horizons = _horizons(metadata, json_path)
        levels = range(len(horizons))
        networks = [_network(tensors, level, tensors_path) for level in levels]
        critics = []
        if f"level0.{_CRITIC}layer0" in tensors:
            critics = [_network(tensors, level, tensors_path, _CRITIC) for level in levels]
        return cls(networks, horizons, metadata, critics)


def _of_seed(network: StackedMLP, seed: int) -> StackedMLP:
    single = StackedMLP(1, (*network.sizes[:-1], network.outputs))
    single.parameters.copy_(network.parameters[seed : seed + 1])
    return single


def _outputs(network: StackedMLP, layer: int) -> int:
    return network.outputs if layer == len(network.weights) - 1 else network.sizes[layer + 1]


def _horizons(description: dict[str, Any], path: Path) -> list[int]:
    value = description.get("horizons")
    if not isinstance(value, list) or not value or not all(map(_is_count, value)):
        raise ValueError(f"{path}: horizons is {value!r}, not a list of counts.")
    return value


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 < value < _MOST_ATTEMPTS


def _chained(layers: list[torch.Tensor]) -> bool:
    """Whether each layer's outputs, and a one, are the next one's inputs."""
    matrices = all(layer.ndim == 2 for layer in layers)
    return matrices and all(a.shape[0] + 1 == b.shape[1] for a, b in itertools.pairwise(layers))


def _network(
    tensors: dict[str, torch.Tensor], level: int, path: Path, prefix: str = ""
) -> StackedMLP:
    layers: list[torch.Tensor] = []
    while f"level{level}.{prefix}layer{len(layers)}" in tensors:
        layers.append(tensors[f"level{level}.{prefix}layer{len(layers)}"])
    if not layers or not _chained(layers):
        raise ValueError(f"{path} lacks a whole network for level {level}.")
    kinds = {str(layer.dtype).removeprefix("torch.") for layer in layers} - {"float32"}
    if kinds:
        raise ValueError(f"{path}: the weights of level {level} are {kinds.pop()}, not float32.")
    if not all(bool(torch.isfinite(layer).all()) for layer in layers):
        raise ValueError(f"{path}: the weights of level {level} are not all finite.")
    sizes = [layer.shape[1] - 1 for layer in layers] + [layers[-1].shape[0]]
    network = StackedMLP(1, sizes)
    for weight, layer in zip(network.weights, layers, strict=True):
        weight[0, : layer.shape[0]] = layer
    return network
