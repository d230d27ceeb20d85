"""Losses of the networks."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from skills.perception.detection.compact_network import AXIS, CENTRE, KIND, OFFSET_UNIT, SEEN, SIZE, SPREAD

PEAK_WEIGHT = 20.0
"""How much more a cell on a peak counts than an empty one: plain squared error collapses to zero on small budgets."""


def finder_loss(
    belief: Tensor, offsets: Tensor, target: Tensor, weight: Tensor, target_offsets: Tensor, offset_weight: Tensor
) -> Tensor:
    """Weighted squared error of the belief maps plus smooth L1 of the offsets near centroids."""
    count = belief.shape[0]
    error = (belief.float() - target) ** 2 * (1.0 + PEAK_WEIGHT * target) * weight
    placed = functional.smooth_l1_loss(offsets.float(), target_offsets, beta=0.5 / OFFSET_UNIT, reduction="none")
    placed = (placed * offset_weight).sum(dim=(0, 2, 3)) / offset_weight.sum().clamp(min=1.0)
    return error.sum() / (count * 600.0) + 8.0 * placed[:16].mean() + 8.0 * placed[16]


def close_look_loss(output: Tensor, target: Tensor, kind: Tensor, visibility: Tensor) -> Tensor:
    """Distances of centroid, size and stem axis, likelihood of their spreads, cross entropy of kind and visibility.

    The spreads learn from residuals that they cannot change: in a joint likelihood the sure centroid drowns the
    unsure axis, and the orientation is hardly learnt. `target` (n, 6) is centroid, log size, axis.
    """
    output = output.float()
    fruit = kind > 0.5
    # Hidden fruit teaches less about how it lies.
    share = fruit * (0.3 + 0.7 * visibility)
    total = share.sum().clamp(min=1.0)
    residual = torch.stack(
        [
            (output[:, CENTRE] - target[:, :2]).norm(dim=1),
            (output[:, SIZE] - target[:, 2]).abs(),
            (output[:, AXIS] - target[:, 3:]).norm(dim=1),
        ],
        dim=1,
    )
    placed = 5.0 * residual[:, 0] + 5.0 * residual[:, 1] + 3.0 * residual[:, 2]
    spread = output[:, SPREAD].clamp(-6.0, 2.0)
    likelihood = (residual.detach() * torch.exp(-spread) + spread).mean(dim=1)
    is_fruit = functional.binary_cross_entropy_with_logits(output[:, KIND], kind)
    seen = functional.binary_cross_entropy_with_logits(output[:, SEEN], visibility, reduction="none")
    return (
        (placed * share).sum() / total
        + 0.2 * (likelihood * share).sum() / total
        + 3.0 * is_fruit
        + 0.3 * (seen * fruit).sum() / fruit.sum().clamp(min=1.0)
    )


def dope_loss(stages: list[tuple[Tensor, Tensor]], belief: Tensor, affinity: Tensor) -> Tensor:
    """The published loss: mean squared error of belief and affinity, summed over the stages."""
    total = belief.new_zeros(())
    for stage_belief, stage_affinity in stages:
        total = total + functional.mse_loss(stage_belief.float(), belief)
        total = total + functional.mse_loss(stage_affinity.float(), affinity)
    return total
