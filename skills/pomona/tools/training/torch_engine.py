"""The compact detector with its networks as PyTorch modules, for training."""

from __future__ import annotations

import copy

import torch
from torch import nn

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.detection.close_look import Network
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.weights_file import Score
from pomona.tools.pytorch.networks import CloseLookNetwork
from pomona.tools.pytorch.weights import Finder


def torch_detector(
    finder: Finder,
    close_look: CloseLookNetwork,
    options: DetectorOptions | None = None,
    scores: Score | None = None,
) -> CompactDetector:
    """Return a detector with copies of two networks, on the CPU and in one thread."""
    return CompactDetector(_network(finder), _network(close_look), options, scores)


def _network(module: nn.Module) -> Network:
    twin = copy.deepcopy(module).cpu().eval().to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def run(pictures: Float32) -> list[Float32]:
        before = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            with torch.inference_mode():
                given = torch.from_numpy(pictures).contiguous(memory_format=torch.channels_last)
                outputs = twin(given)
        finally:
            torch.set_num_threads(before)
        parts = outputs if isinstance(outputs, tuple) else (outputs,)
        return [part.float().numpy() for part in parts]

    return run
