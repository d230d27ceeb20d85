"""How well the finder alone searches photographs and rendered frames, measured while it learns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
import torch
from torch import nn

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import FINDER_MULTIPLE
from pomona.skills.perception.detection.places import Proposal, read_places
from pomona.tools.photographs.box_evaluation import curve
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.pytorch.networks import to_input
from pomona.tools.training.samples import FrameFolder

Finds = tuple[
    Float64, Float64, Float64
]  # of a picture: found boxes (n, 4), their scores (n,), true boxes (m, 4)
PRECISION = 0.9  # recall is reported where precision is at least this
FRAMES, FRAME_WIDTH = (
    30,
    320,
)  # rendered frames that are searched, and the width to which they are shrunk [px]


def finder_figures(
    frames: FrameFolder | None, photographs: PhotoSet | None, device: str
) -> Callable[[nn.Module], dict[str, float]]:
    """Return figures of a finder on some photographs and on some rendered frames, of those that there are."""
    # photographs that are searched while training goes on, evenly from all of those to measure on
    val = () if photographs is None else photographs.val[:: max(1, len(photographs.val) // 65)]

    def measure(network: nn.Module) -> dict[str, float]:
        figures: dict[str, float] = {}
        if val:
            found = [
                _finds(places_in(network, photo.picture(), photo.scale, device), photo.boxes)
                for photo in val
            ]
            figures |= _named("photographs", found)
        if frames is not None:
            found = []
            for k in range(min(FRAMES, len(frames))):
                annotation, picture = frames.annotation(k), frames.picture(k, halved=False)
                # rendered fruit of which less is visible is not asked for
                boxes = [
                    item.box for item in annotation.objects if item.box and item.visibility >= 0.3
                ]
                places = places_in(network, picture, FRAME_WIDTH / annotation.width, device)
                found.append(_finds(places, np.array(boxes, np.float64).reshape(-1, 4)))
            figures |= _named("rendered", found)
        return figures

    return measure


def places_in(
    network: nn.Module, picture: UInt8, scale: float, device: str = "cpu"
) -> list[Proposal]:
    """Places that a finder proposes in a picture (h, w, 3) that is shrunk by `scale`, in pixels of the picture."""
    height, width = picture.shape[:2]
    small = round(width * scale), round(height * scale)
    shrunk = cv2.resize(
        picture, small, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    )
    below, right = -small[1] % FINDER_MULTIPLE, -small[0] % FINDER_MULTIPLE
    padded = cv2.copyMakeBorder(
        shrunk, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114)
    )
    with torch.inference_mode():
        maps = network(to_input(torch.from_numpy(padded[None]).to(device)))[0].float().cpu().numpy()
    return [place.scaled(width / small[0]) for place in read_places(maps, *small)]


def _finds(places: Sequence[Proposal], wanted: Float64) -> Finds:
    boxes = np.array([place.box for place in places]).reshape(-1, 4)
    return boxes, np.array([place.score for place in places], np.float64), wanted


def _named(name: str, found: Sequence[Finds]) -> dict[str, float]:
    result = curve(found)
    return {
        f"{name} AP50": result.average_precision,
        f"recall at precision {PRECISION:.2f}, {name}": result.recall_at(PRECISION),
        f"{name} AP75": curve(found, 0.75).average_precision,
    }
