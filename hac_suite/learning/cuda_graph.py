"""A round of updates as one call: on a GPU one CUDA graph, captured once and replayed after."""

from collections.abc import Callable, Sequence

import torch

Work = Callable[[], None]


def capture(work: Work) -> Work:
    """Records the GPU's part of `work`; what is returned repeats it on what memory holds then."""
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph.replay


class CapturedRound:
    """Calls `update` with a list of tensors, whose shapes never change.

    The first call runs as it is: libraries make handles and networks make buffers on their first
    use, which a capture must not see. The second call captures, and all that follow only replay.
    """

    def __init__(
        self,
        update: Callable[[Sequence[torch.Tensor]], None],
        capture: Callable[[Work], Work] = capture,
    ):
        self._update, self._capture = update, capture
        self._inputs: list[torch.Tensor] = []
        self._replay: Work | None = None

    def __call__(self, inputs: Sequence[torch.Tensor]) -> None:
        if not self._inputs:
            self._inputs = [tensor.clone() for tensor in inputs]
            self._update(self._inputs)
            return
        for held, given in zip(self._inputs, inputs, strict=True):
            held.copy_(given)
        if self._replay is None:
            self._replay = self._capture(lambda: self._update(self._inputs))
        self._replay()
