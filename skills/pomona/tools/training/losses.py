"""Losses of the networks."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from pomona.skills.perception.detection import close_look as rows
from pomona.skills.perception.detection.close_look import AXIS, CENTRE, KIND, SEEN, SIZE, SPREAD
from pomona.tools.training import targets

# weights of the finder's losses of boxes and of their quality, beside that of the heat
BOXES = 2.0
QUALITIES = 0.5
LOG_REACHES = (
    -3.0,
    5.0,
)  # bounds of the logarithm of a reach [cells] before it is raised: no step overflows


def finder_loss(maps: Tensor, wanted: Tensor) -> Tensor:
    """Of the finder's maps (n, 6, h, w) against `finder_targets` (n, 8, h, w).

    CenterNet's focal loss of the heat, generalised IoU of the boxes near each middle, and cross entropy of the quality
    against the IoU that the box has now.
    """
    maps = maps.float()
    heat = focal_loss(
        maps[:, rows.HEAT],
        wanted[:, targets.HEAT],
        wanted[:, targets.PEAK],
        wanted[:, targets.WEIGHT],
    )
    reaches = maps[:, rows.REACHES].clamp(*LOG_REACHES).exp()
    overlap, generalised = _overlaps(reaches, wanted[:, targets.REACHES])
    weight = wanted[:, targets.BOX_WEIGHT]
    total = weight.sum().clamp(min=1.0)
    boxes = ((1.0 - generalised) * weight).sum() / total
    quality = functional.binary_cross_entropy_with_logits(
        maps[:, rows.QUALITY], overlap.detach(), weight=weight, reduction="sum"
    )
    return heat + BOXES * boxes + QUALITIES * quality / total


def focal_loss(logit: Tensor, heat: Tensor, peak: Tensor, weight: Tensor) -> Tensor:
    """CenterNet's, per peak: its logarithm, and that of all other cells, the less the nearer a peak is."""
    p = logit.sigmoid()
    there = (1.0 - p) ** 2 * functional.logsigmoid(logit) * peak
    elsewhere = (1.0 - heat) ** 4 * p**2 * functional.logsigmoid(-logit) * (1.0 - peak) * weight
    return -(there + elsewhere).sum() / peak.sum().clamp(min=1.0)


def _overlaps(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """IoU and generalised IoU of boxes given by reaches from the same cells, (n, 4, h, w) each: (n, h, w)."""

    def area(sides: Tensor) -> Tensor:
        return (sides[:, 0] + sides[:, 2]) * (sides[:, 1] + sides[:, 3])

    shared = area(torch.minimum(a, b))
    union = (area(a) + area(b) - shared).clamp(min=1e-6)
    around = area(torch.maximum(a, b)).clamp(min=1e-6)
    overlap = shared / union
    return overlap, overlap - (around - union) / around


def close_look_loss(output: Tensor, target: Tensor, kind: Tensor, visibility: Tensor) -> Tensor:
    """Return distances of centroid, size and stem axis, likelihood of spreads, cross entropy of kind and visibility.

    The spreads learn from residuals that they cannot change: in a joint likelihood the sure centroid drowns the
    unsure axis, and the orientation is hardly learnt. `target` (n, 6) is centroid, log size, axis.
    """
    output = output.float()
    fruit = kind > 0.5
    # Hidden fruit teaches less about how it lies.
    share = (fruit * (0.3 + 0.7 * visibility))[:, None]
    total = share.sum().clamp(min=1.0)
    residual = torch.stack(
        [
            (output[:, CENTRE] - target[:, :2]).norm(dim=1),
            (output[:, SIZE] - target[:, 2]).abs(),
            (output[:, AXIS] - target[:, 3:6]).norm(dim=1),
        ],
        dim=1,
    )
    placed = (residual * share).sum(dim=0) / total * residual.new_tensor([5.0, 5.0, 3.0])
    spread = output[:, SPREAD].clamp(-6.0, 2.0)
    likelihood = ((residual.detach() * torch.exp(-spread) + spread) * share).sum(dim=0) / total
    is_fruit = functional.binary_cross_entropy_with_logits(output[:, KIND], kind)
    seen = functional.binary_cross_entropy_with_logits(
        output[:, SEEN], visibility, reduction="none"
    )
    seen = (seen * fruit).sum() / fruit.sum().clamp(min=1.0)
    return placed.sum() + 0.2 * likelihood.mean() + 3.0 * is_fruit + 0.3 * seen
