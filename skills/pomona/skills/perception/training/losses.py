"""Losses of the networks."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.outputs import (
    AXIS,
    BOX,
    CENTRE,
    FINDER_STRIDE,
    KIND,
    OFFSET_UNIT,
    SEEN,
    SIZE,
    SPREAD,
)

PEAK_WEIGHT = 20.0
"""How much more a cell on a peak counts than an empty one: plain squared error collapses to zero on small budgets."""


CONFIDENT = 0.5
"""A belief above this, of a fruit as large as the labelled, is doubted where people drew no box: they left some out."""

AS_LARGE = 0.65
"""What is smaller than this part of the labelled fruit is far behind, and is taught as background."""

FRUIT_IN_INPUT = 46.0
"""Median longer side of the boxes in the finder's input [px]: as large as most rendered fruit."""

DOUBTED = 0.25
"""How much a doubted place counts as no fruit: leaves that deceive are unlearnt so, and fruit that looks like the
labelled stays fruit. Not counting them at all leaves the leaves (docs/decisions/detect-photographs.md)."""


CENTRES, BOXES = 2.0, 4.0
"""Weights of the centroid's and the boxes' losses beside those of corners and sizes."""

SURE = 1.0
"""The same for the close look's logit of kind."""


_LARGE_OFFSET = math.log(AS_LARGE * SIZE_OF_BOX * FRUIT_IN_INPUT / (FINDER_STRIDE * OFFSET_UNIT))


def finder_loss(
    outputs: tuple[Tensor, ...],
    target: Tensor,
    weight: Tensor,
    target_offsets: Tensor,
    offset_weight: Tensor,
    cornered: Tensor,
    unlabelled: Tensor,
    peak: Tensor,
    reaches: Tensor,
    reach_weight: Tensor,
) -> Tensor:
    """Of the finder's belief, offsets and boxes; the targets are those of `FinderTargets`, (n, …) each.

    Weighted squared error of the corners' maps, smooth L1 of offsets near centroids, focal loss of the centroid's
    probability, and generalised IoU of the boxes.
    """
    belief, offsets, found = outputs
    count, belief = belief.shape[0], belief.float()
    error = (belief[:, :8] - target[:, :8]) ** 2 * (1.0 + PEAK_WEIGHT * target[:, :8]) * weight * cornered
    large = offsets[:, 16:].detach().float() > _LARGE_OFFSET
    forgiven = (1.0 - DOUBTED) * unlabelled * large * (belief[:, 8:].detach() > CONFIDENT) * (target[:, 8:] < 0.05)
    placed = functional.smooth_l1_loss(offsets.float(), target_offsets, beta=0.5 / OFFSET_UNIT, reduction="none")
    placed = placed * offset_weight
    arms = (placed[:, :16] * cornered).sum(dim=(0, 2, 3)) / (offset_weight * cornered).sum().clamp(min=1.0)
    size = placed[:, 16].sum() / offset_weight.sum().clamp(min=1.0)
    centres = focal_loss(belief[:, 8:], target[:, 8:], peak, weight * (1.0 - forgiven))
    boxes = ((1.0 - _generalised_iou(found, reaches)) * reach_weight[:, 0]).sum() / reach_weight.sum().clamp(min=1.0)
    return error.sum() / (count * 600.0) + 8.0 * arms.mean() + 8.0 * size + CENTRES * centres + BOXES * boxes


def focal_loss(belief: Tensor, target: Tensor, peak: Tensor, weight: Tensor) -> Tensor:
    """CenterNet's: the peaks' logarithms, and those of everything else the less the nearer a peak is, for each peak."""
    p = belief.clamp(1e-4, 1.0 - 1e-4)
    there = (1.0 - p) ** 2 * torch.log(p) * peak
    elsewhere = (1.0 - target) ** 4 * p**2 * torch.log(1.0 - p) * (1.0 - peak) * weight
    return -(there + elsewhere).sum() / peak.sum().clamp(min=1.0)


def _generalised_iou(a: Tensor, b: Tensor) -> Tensor:
    """Of boxes that reach left, up, right and down of the same cells, (n, 4, h, w) each [cells]: -1..1, (n, h, w)."""

    def area(sides: Tensor) -> Tensor:
        return (sides[:, 0] + sides[:, 2]) * (sides[:, 1] + sides[:, 3])

    shared = area(torch.minimum(a, b))
    union = area(a) + area(b) - shared
    around = area(torch.maximum(a, b))
    return shared / union.clamp(min=1e-6) - (around - union) / around.clamp(min=1e-6)


def close_look_loss(output: Tensor, target: Tensor, kind: Tensor, visibility: Tensor, known: Tensor) -> Tensor:
    """Distances of centroid, size, stem axis and box, likelihood of spreads, cross entropy of kind and visibility.

    The spreads learn from residuals that they cannot change: in a joint likelihood the sure centroid drowns the
    unsure axis, and the orientation is hardly learnt. `target` (n, 10) is centroid, log size, axis, box; `known` (n, 6)
    says which of these count. Where visibility itself is not known it is a bound, and only what exceeds it counts.
    """
    output = output.float()
    fruit = kind > 0.5
    # Hidden fruit teaches less about how it lies.
    share = (fruit * (0.3 + 0.7 * visibility))[:, None] * known[:, :4]
    total = share.sum(dim=0).clamp(min=1.0)
    residual = torch.stack(
        [
            (output[:, CENTRE] - target[:, :2]).norm(dim=1),
            (output[:, SIZE] - target[:, 2]).abs(),
            (output[:, AXIS] - target[:, 3:6]).norm(dim=1),
        ],
        dim=1,
    )
    placed = (residual * share[:, :3]).sum(dim=0) / total[:3] * residual.new_tensor([5.0, 5.0, 3.0])
    spread = output[:, SPREAD].clamp(-6.0, 2.0)
    likelihood = ((residual.detach() * torch.exp(-spread) + spread) * share[:, :3]).sum(dim=0) / total[:3]
    boxes = (output[:, BOX] - target[:, 6:]).abs().mean(dim=1)
    sure = (1.0 - DOUBTED) * known[:, 5] * (output[:, KIND].detach() > SURE)
    is_fruit = functional.binary_cross_entropy_with_logits(output[:, KIND], kind, reduction="none")
    seen = functional.binary_cross_entropy_with_logits(output[:, SEEN], visibility, reduction="none")
    seen = seen * fruit * torch.maximum(known[:, 4], (output[:, SEEN].detach().sigmoid() > visibility).float())
    return (
        placed.sum()
        + 0.2 * likelihood.mean()
        + 5.0 * (boxes * share[:, 3]).sum() / total[3]
        + 3.0 * (is_fruit * (1.0 - sure)).mean()
        + 0.3 * seen.sum() / fruit.sum().clamp(min=1.0)
    )


def dope_loss(stages: list[tuple[Tensor, Tensor]], belief: Tensor, affinity: Tensor) -> Tensor:
    """The published loss: mean squared error of belief and affinity, summed over the stages."""
    total = belief.new_zeros(())
    for stage_belief, stage_affinity in stages:
        total = total + functional.mse_loss(stage_belief.float(), belief)
        total = total + functional.mse_loss(stage_affinity.float(), affinity)
    return total
