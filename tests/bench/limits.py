"""How much of the machine's speed in matrix products the updates reach."""

import contextlib
import dataclasses
import itertools
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

import torch

import hac_suite
from hac_suite.config import PrecisionName
from hac_suite.learning.ddpg import DDPG
from tests.bench.population import TASK, Training
from tests.bench.repeats import REPEATS, entry, rounded
from tests.bench.same_work import precisions
from tests.bench.team import Team

BATCHES = (256, 1024)
SEEDS = 10
_SIZE = 1024  # of the square matrices that the machine's speed is taken with
_PRODUCTS = 10
_ROWS = 50_000  # in each replay buffer


class Rates(NamedTuple):
    """FLOP/s of updates, and of square products taken just before and after."""

    updates: float
    products: float


class Updates:
    """Whole rounds of updates of a flat population: drawing, gathering, learning, averaging."""

    def __init__(self, batch: int, precision: PrecisionName):
        config = dataclasses.replace(
            hac_suite.PRESETS["suite"], batch_size=batch, precision=precision
        )
        self._training = Training(TASK, config, range(SEEDS), 0)
        self._training.fill([_ROWS])
        self._flops = update_flops(self._training.learners[0], batch)
        self._square = torch.randn(3, _SIZE, _SIZE)

    def __call__(self) -> Rates:
        before = self._products()
        work = self._training.learn()
        after = self._products()
        return Rates(work.updates * self._flops / work.seconds, (before + after) / 2)

    def _products(self) -> float:
        a, b, out = self._square
        start = time.perf_counter()
        for _ in range(_PRODUCTS):
            torch.mm(a, b, out=out)
        return _PRODUCTS * 2 * _SIZE**3 / (time.perf_counter() - start)


def update_flops(learner: DDPG, batch: int) -> int:
    """What the products of one seed's DDPG update need, 2mnk each; biases are not counted.

    Forward passes of the target actor, the target critic, the critic, the actor, and the critic
    again; gradients of the critic's weights and hidden layers, then of its hidden layers and of
    the action among its inputs, then of the actor's weights and hidden layers.
    """
    actor = product_flops((*learner.actor.sizes[:-1], learner.actor.outputs), batch)
    critic = product_flops((*learner.critic.sizes[:-1], learner.critic.outputs), batch)
    actions = learner.actor.outputs
    into_action = 2 * batch * actions * learner.critic.sizes[1]
    forward = 2 * sum(actor) + 3 * sum(critic)
    critic_backward = sum(critic) + sum(critic[1:])  # the first layer's input needs no gradient
    through_critic = sum(critic[1:]) + into_action
    actor_backward = sum(actor) + sum(actor[1:])
    return forward + critic_backward + through_critic + actor_backward


def product_flops(sizes: Sequence[int], batch: int) -> list[int]:
    """2mnk of each layer's forward product; its two gradients take as many each."""
    return [2 * batch * i * o for i, o in itertools.pairwise(sizes)]


def gemm(say: Callable[[str], None]) -> dict[str, Any]:
    """`gemm_share`, the lesser share of both batch sizes, and each of them.

    Where the processor has bf16, also how many times as fast updates are with it.
    """
    rates: dict[tuple[int, str], list[Rates]] = {}
    with contextlib.ExitStack() as opened:
        teams = {}
        for case in itertools.product(BATCHES, precisions()):
            batch, precision = case
            say(f"updates of {SEEDS} seeds, batch {batch}, {precision}, and products of {_SIZE}^3")
            teams[case] = opened.enter_context(Team(Updates, [case]))
            rates[case] = []
        for repeat in range(1 + REPEATS):
            for case, team in teams.items():
                (measured,) = team.work()[1]
                if repeat:  # the first is a warm-up
                    rates[case].append(measured)
    exact = {batch: rates[batch, "fp32"] for batch in BATCHES}
    shares = {batch: [r.updates / r.products for r in exact[batch]] for batch in BATCHES}
    worst = min(shares.values(), key=median)
    report = entry("gemm_share", worst)
    for batch in BATCHES:
        report |= entry(f"gemm_share_b{batch}", shares[batch])
        report[f"update_gflops_b{batch}"] = rounded(median(r.updates for r in exact[batch]) / 1e9)
        if in_bf16 := rates.get((batch, "bf16")):
            pairs = zip(in_bf16, exact[batch], strict=True)
            ratios = [mixed.updates / other.updates for mixed, other in pairs]
            report |= entry(f"update_speed_bf16_b{batch}", ratios)
    report["gemm_gflops"] = rounded(median(r.products for v in exact.values() for r in v) / 1e9)
    return report
