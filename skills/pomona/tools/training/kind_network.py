"""The network of kinds in PyTorch: a published trunk that stays as it is, and two layers that learn on top of it."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.tools.pytorch.networks import FinderNetwork, Trunk

TAPS = {4: 40, 10: 112}  # blocks of the trunk whose features are read, and their channels
POOLS = 3  # numbers of each channel: mean of all, mean and maximum of the middle
FEATURES = POOLS * sum(TAPS.values())
HIDDEN = 64


class KindNetwork(nn.Module):
    """Logits of kinds (n, kinds) of pictures (n, 3, 96, 96), RGB in 0..1 minus 0.5.

    Args:
        kinds: number of logits.
        trunk: of a finder, with its weights; None for the shape alone.
    """

    def __init__(self, kinds: int, trunk: Trunk | None = None) -> None:
        super().__init__()
        whole = trunk or FinderNetwork().trunk
        self.stem, self.blocks = whole.stem, nn.ModuleList(list(whole.blocks)[: max(TAPS) + 1])
        self.requires_grad_(False)
        self.register_buffer("middle", torch.zeros(FEATURES))
        self.register_buffer("spread", torch.ones(FEATURES))
        self.hidden, self.last = nn.Linear(FEATURES, HIDDEN), nn.Linear(HIDDEN, kinds)

    def features(self, pictures: Tensor) -> Tensor:
        """Return the trunk's numbers of pictures, (n, 456)."""
        x = functional.relu6(
            self.stem((255.0 * pictures + 0.5) / 128.0)
        )  # it learnt from (value - 127) / 128
        found = []
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in TAPS:
                edge = x.shape[-1] // 4
                inner = x[:, :, edge:-edge, edge:-edge]
                found += [x.mean(dim=(2, 3)), inner.mean(dim=(2, 3)), inner.amax(dim=(2, 3))]
        return torch.cat(found, dim=1)

    def measure(self, features: Tensor) -> None:
        """Take mean and deviation of features (n, 456), by which they are normalised."""
        cast(Tensor, self.middle).copy_(features.mean(dim=0))
        cast(Tensor, self.spread).copy_(features.std(dim=0) + 1e-3)

    def judge(self, features: Tensor) -> Tensor:
        """Return logits (n, kinds) of features (n, 456)."""
        x = (features - cast(Tensor, self.middle)) / cast(Tensor, self.spread)
        x = functional.dropout(x, 0.2, self.training)
        x = functional.dropout(functional.relu(self.hidden(x)), 0.3, self.training)
        return cast(Tensor, self.last(x))

    def forward(self, pictures: Tensor) -> Tensor:
        """Logits (n, kinds)."""
        return self.judge(self.features(pictures))

    def train(self, mode: bool = True) -> KindNetwork:
        """As of any network; the trunk keeps its statistics."""
        super().train(mode)
        self.stem.eval()
        self.blocks.eval()
        return self
