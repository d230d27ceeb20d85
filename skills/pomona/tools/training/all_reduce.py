"""Several processes that learn one network: each takes its part of every batch, all take the mean of the gradients.

On these small layers two processes with a thread each take three quarters of the time of one process with two threads,
since they meet once a step and not in every layer.
"""

from __future__ import annotations

import threading
from typing import Any

import torch
from torch import nn
from torch.multiprocessing import get_context

from pomona.skills.perception.detection.errors import BadTraining

CONTEXT = get_context("spawn")


class GradientAllReduce:
    """Memory that the processes share; made by the first and handed to the others."""

    def __init__(self, processes: int, network: nn.Module) -> None:
        weights = sum(p.numel() for p in network.parameters() if p.requires_grad)
        self._gradients = torch.zeros(processes, weights).share_memory_()  # type: ignore[no-untyped-call]
        self._met: Any = CONTEXT.Barrier(processes)

    def mean(self, rank: int, network: nn.Module) -> None:
        """Put the mean of all processes' gradients in place of the network's own.

        Raises BadTraining: another process has ended.
        """
        gradients = [p.grad for p in network.parameters() if p.grad is not None]
        torch.cat([gradient.flatten() for gradient in gradients], out=self._gradients[rank])
        self._meet()
        mean = self._gradients.mean(dim=0)
        self._meet()
        for gradient, part in zip(
            gradients, mean.split([g.numel() for g in gradients]), strict=True
        ):
            gradient.copy_(part.view(gradient.shape))

    def abandon(self) -> None:
        """Let no process wait for this one any longer."""
        self._met.abort()

    def _meet(self) -> None:
        try:
            self._met.wait(
                600.0
            )  # longest wait for the others [s]: the first process validates and saves in between
        except threading.BrokenBarrierError as error:
            raise BadTraining(
                "a process that trains beside this one has ended; start again to resume"
            ) from error
