"""The compact detector with its networks as PyTorch modules, for training."""

from __future__ import annotations

import copy

import torch
from torch import nn

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.detection.close_look import Network
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork


def torch_detector(finder: FinderNetwork, close_look: CloseLookNetwork) -> CompactDetector:
    """Return a detector with copies of two networks, on the CPU and in one thread."""
    return CompactDetector(_network(finder), _network(close_look))


def _network(module: nn.Module) -> Network:
    twin = copy.deepcopy(module).cpu().eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def run(pictures: Float32) -> list[Float32]:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            with torch.inference_mode():
                given = torch.from_numpy(pictures).contiguous(memory_format=torch.channels_last)
                return [twin(given).numpy()]
        finally:
            torch.set_num_threads(before)

    return run
