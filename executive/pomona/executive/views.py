"""Views of a skill for the operator: a few plain pictures that every viewer can draw.

A skill publishes a view under a topic (`self.publish("detection", ImageView(...))`); the run's picture, the recording
and the dashboard draw it without knowing the skill.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64


@dataclass(frozen=True, slots=True, eq=False)
class Line2:
    """A polyline in an image, shape (n, 2) [px]; NaN rows break it. `style` is a role: found, refined, muted."""

    points: Float64
    label: str = ""
    style: str = "found"
    closed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Pinhole:
    """How an image was taken: u = fx x / z + cx [px], and the camera's pose in the base frame, 4 x 4, where known."""

    fx: float
    fy: float
    cx: float
    cy: float
    T_base_camera: Float64 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImageView:
    """A camera's image with drawings over it.

    Attributes:
        image: RGB, shape (h, w, 3), uint8; None draws over the newest image.
        lines: polylines over it.
        points: marked points, shape (n, 2) [px].
        caption: one line below it.
        depth: z-depth of the same pixels, shape (h, w) [m], 0 where there is none: for the record, not for a screen.
        pinhole: how both were taken.
    """

    image: NDArray[np.uint8] | None
    lines: tuple[Line2, ...] = ()
    points: Float64 = field(default_factory=lambda: np.empty((0, 2)))
    caption: str = ""
    depth: NDArray[np.float32] | None = None
    pinhole: Pinhole | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Line3:
    """A polyline in the base frame, shape (n, 3) [m]. `style` is a role: planned, executed, approach, muted."""

    points: Float64
    label: str = ""
    style: str = "planned"


@dataclass(frozen=True, slots=True, eq=False)
class Points3:
    """Points in the base frame, shape (n, 3) [m], all of one size [m].

    `style` is a role: occupied, free, chosen, ruled_out, tried.
    """

    points: Float64
    label: str = ""
    style: str = "occupied"
    size: float = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Mesh3:
    """A triangle mesh posed in the base frame: vertices (n, 3) [m], faces (m, 3)."""

    vertices: Float64
    faces: NDArray[np.int32]
    label: str = ""
    style: str = "object"


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """Things in space, in the base frame. Views of different topics are drawn into one scene."""

    lines: tuple[Line3, ...] = ()
    points: tuple[Points3, ...] = ()
    meshes: tuple[Mesh3, ...] = ()
    caption: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class BodiesView:
    """Rigid bodies, each in its own frame, shown once; a `PosesView` of the same topic has their poses."""

    bodies: tuple[Mesh3, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PosesView:
    """Present poses of the bodies of the topic's `BodiesView`.

    Attributes:
        poses: of each body in the base frame, shape (n, 7): position [m] and quaternion x, y, z, w.
        trace: a point of theirs, shape (3,) [m], whose path is drawn as the executed path.
    """

    poses: Float64
    trace: Float64


@dataclass(frozen=True, slots=True, eq=False)
class SeriesView:
    """More samples of quantities over the run's clock; samples of one topic are drawn as one plot.

    Attributes:
        t: times, shape (n,) [s] on the cell's clock.
        values: by name, shape (n,) each; the name carries the unit: `grasp force [N]`.
        thresholds: constant lines by name.
    """

    t: Float64
    values: Mapping[str, Float64]
    thresholds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TableView:
    """Rows of a table, for example of measured fruit."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class ProgressView:
    """Progress of a task: `what` is the current object, `number` its place among `of` known ones."""

    what: str
    number: int
    of: int
