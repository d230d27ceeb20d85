"""The exact truth about the fruit and the decoys of a rendered scene."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.detection.close_look import STEM_AXIS, label_rotation
from pomona.skills.perception.detection.instances import cuboid_keypoints
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training.contents import SyntheticScene
from pomona.tools.training.options import SceneOptions


@dataclass(frozen=True, slots=True, eq=False)
class FruitTruth:
    """One fruit of a rendered frame."""

    T_camera_object: Float64  # the label's pose: the swing rule's rotation, the true centre
    dimensions: Float64  # true cuboid along the object's axes [m]
    scale: float  # size of the CAD model that fits best (least squares over the three dimensions)
    keypoints: Float64  # the scaled CAD cuboid in the picture, (9, 2) [px]
    visibility: float  # part of the silhouette that is in the picture and not covered
    box: tuple[int, int, int, int]  # x, y, w, h of the visible pixels [px]; zeros when none


def true_fruit(
    fruit: FruitModel,
    options: SceneOptions,
    scene: SyntheticScene,
    owner: NDArray[np.int32],
    P: Float32,
    F: NDArray[np.int32],
    owner_of_face: NDArray[np.int32],
) -> tuple[FruitTruth, ...]:
    """Return the truth about one rendered fruit: pose, keypoints, and how much of it is seen."""
    fx, fy, cx, cy = options.camera
    T_wc = scene.T_world_camera
    R_cw = T_wc[:3, :3].T
    eye = T_wc[:3, 3]
    cad = cuboid_keypoints(fruit.dimensions)
    flesh = {
        item.fruit: k
        for k, item in enumerate(scene.items)
        if item.fruit >= 0 and len(item.shape.faces) > 500
    }
    truths = []
    for order, (rotation, centre_world, dimensions, _) in enumerate(scene.truths):
        centre = R_cw @ (centre_world - eye)
        scale = float(dimensions @ fruit.dimensions / (fruit.dimensions @ fruit.dimensions))
        T = np.eye(4)
        T[:3, :3] = label_rotation(R_cw @ rotation @ STEM_AXIS, centre)
        T[:3, 3] = centre
        corners = (scale * cad) @ T[:3, :3].T + centre
        keypoints = corners[:, :2] / corners[:, 2:] * (fx, fy) + (cx, cy)
        k = flesh[order]
        first = np.searchsorted(owner_of_face, k)
        own = P[np.unique(F[first : np.searchsorted(owner_of_face, k, side="right")])]
        outline = own[:, :2] / own[:, 2:] * (fx, fy) + (cx, cy)
        silhouette = cv2.contourArea(cv2.convexHull(outline.astype(np.float32)))
        v, u = np.nonzero(owner == k)
        box = (
            (int(u.min()), int(v.min()), int(np.ptp(u)) + 1, int(np.ptp(v)) + 1)
            if len(u)
            else (0, 0, 0, 0)
        )
        truths.append(
            FruitTruth(
                T, dimensions, scale, keypoints, min(1.0, len(u) / max(silhouette, 1.0)), box
            )
        )
    return tuple(truths)


def decoy_circle(
    options: SceneOptions, centre: Float64, radius: float
) -> tuple[float, float, float]:
    """Where a round thing that is no fruit shows in the picture: centre and radius [px]."""
    fx, fy, cx, cy = options.camera
    return (
        float(fx * centre[0] / centre[2] + cx),
        float(fy * centre[1] / centre[2] + cy),
        float(fx * radius / centre[2]),
    )
