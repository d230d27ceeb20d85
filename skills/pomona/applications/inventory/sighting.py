"""One fruit in one frame, as numbers: the frame's images are not kept."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pomona.drivers import Frame
from pomona.executive import Float64
from pomona.skills.perception import Detection, FruitModel, MeasuredFruit

SIZE_SPREAD = 0.2
"""Standard deviation of a fruit's size beside the model's, as a share: how far away one is that was not measured. The
orchard's 52 calipered apples are 0.60 to 0.86 of the model wide."""

Z_90 = 1.6449  # quantile of the normal distribution for an interval of 90 %, in standard deviations


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One fruit in one frame."""

    frame: str  # label of the frame
    number: int  # in its frame, from 1, as it is drawn
    score: float  # belief that it is fruit, 0 to 1
    visibility: float  # share of its silhouette that is seen, as the detector estimates it; NaN where it does not
    # centre in the base frame, shape (3,) [m]; where it was not measured, of a fruit of the model's size
    p_base: Float64
    place_covariance: Float64  # of `p_base`, shape (3, 3) [m²]
    distance: float  # from the camera [m]
    fruit: FruitModel  # the model
    R_base_fruit: Float64  # the fruit's axes in the base frame, shape (3, 3)
    dimensions: (
        Float64 | None
    )  # (d_x, d_y, d_z), d_y the height, shape (3,) [m]; None where it was not measured
    size_covariance: Float64 | None  # of the dimensions, shape (3, 3) [m²]; None with them
    outline: Float64  # in the image, shape (n, 2) [px]; a box where it was not measured
    centre: Float64  # in the image, shape (2,) [px]
    agreeing: float  # share of its depth that agrees with its shape; NaN where it was not measured
    why: str  # it was not measured; empty where it was
    # width of the model as it was scaled, and its standard deviation, shape (2,) [m]; NaN where it was not measured
    shown: Float64 = field(default_factory=lambda: np.full(2, np.nan))
    from_side: float = float(
        "nan"
    )  # sine of the angle between the line of sight and the stem's axis
    method: str = ""  # by which it was measured; empty where it was not

    def moved(self, T: Float64) -> Sighting:
        """Return the same, with its place in the frame into which T (4, 4) leads from the base frame."""
        R = T[:3, :3]
        return replace(
            self,
            p_base=R @ self.p_base + T[:3, 3],
            place_covariance=R @ self.place_covariance @ R.T,
            R_base_fruit=R @ self.R_base_fruit,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FrameSightings:
    """The sightings in one frame so far."""

    frame: Frame
    sightings: tuple[Sighting, ...]

    @property
    def sentence(self) -> str:
        """Description for the operator."""
        measured = sum(sighting.dimensions is not None for sighting in self.sightings)
        return f"{measured} of {len(self.sightings)} fruit measured"


def sighting_of(
    detection: Detection, measured: MeasuredFruit | None, why: str, number: int
) -> Sighting:
    """Return a sighting from a detection and its measurement, or the reason `why` there is none.

    Args:
        detection: the fruit as it was found.
        measured: the same fruit as it was measured; ignored when `why` is not empty.
        why: reason why it was not measured.
        number: in its frame, from 1.
    """
    frame, T_base_camera = detection.frame, detection.T_base_camera
    label = label_of(frame)
    if measured is None or why:
        p = detection.T_camera_object[:3, 3]
        along = SIZE_SPREAD * p  # twice as large a fruit is twice as far
        R = T_base_camera[:3, :3]
        covariance = R @ (detection.covariance[3:, 3:] + np.outer(along, along)) @ R.T
        return Sighting(
            frame=label,
            number=number,
            score=detection.score,
            visibility=detection.visibility,
            p_base=R @ p + T_base_camera[:3, 3],
            place_covariance=covariance,
            distance=float(np.linalg.norm(p)),
            fruit=detection.fruit,
            R_base_fruit=R @ detection.T_camera_object[:3, :3],
            dimensions=None,
            size_covariance=None,
            outline=_box(detection.keypoints[:8]),
            centre=detection.keypoints[8],
            agreeing=float("nan"),
            why=why or "it was not measured",
        )
    p_base = measured.T_base_fruit[:3, 3]
    outline = measured.contour
    shown = measured.mu * float(measured.fruit.dimensions[[0, 2]].mean())
    away = p_base - measured.T_base_camera[:3, 3]
    distance = float(np.linalg.norm(away))
    return Sighting(
        frame=label,
        number=number,
        score=detection.score,
        visibility=detection.visibility,
        p_base=p_base,
        place_covariance=measured.covariance[:3, :3],
        distance=distance,
        fruit=measured.fruit,
        R_base_fruit=measured.T_base_fruit[:3, :3],
        dimensions=measured.dimensions,
        size_covariance=measured.covariance[3:, 3:],
        outline=outline,
        centre=outline.mean(axis=0) if outline.size else detection.keypoints[8],
        agreeing=measured.inlier_ratio,
        why="",
        shown=shown * np.array([1.0, detection.size_deviation]),
        from_side=float(np.linalg.norm(np.cross(away / distance, measured.T_base_fruit[:3, 1]))),
        method=measured.method,
    )


def label_of(frame: Frame) -> str:
    """Return a frame's name for the operator."""
    return frame.label or f"frame {frame.sequence}"


def _box(points: Float64) -> Float64:
    """Return the box around points in the image, those that were found, shape (4, 2) [px]; empty without any."""
    if not np.isfinite(points).all(axis=1).any():
        return np.empty((0, 2))
    (left, top), (right, bottom) = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
