"""Compares a frame with the table and with its own colour: is the depth this frame's, and the camera's pose true?

The table's plane in a depth image is compared with the cell file's table as the camera's stated pose places it. A plane
shows the camera's height above it and both angles between them: an error of the pose along the plane or about its
normal changes neither. Differently tilted looks see different parts of such an error.

Depth that is mirrored, turned, shifted or foreign gives wrong sizes. Where depth changes, colour mostly does too, and
along the same line. So the directions of both gradients (the normalised gradient fields of Haber and Modersitzki, 2006)
agree most for the correct registration. The score of a shift is the difference of its mean agreement to that of all
shifts, in their standard deviations.

A table at the wrong place or tilt is evidence against one of several statements. Depth that is mirrored, is a tenth
too long or more, or that fits an earlier pose of the camera, is no depth of this frame (DEPTH_MISMATCH); else the
camera's pose, the depth's scale or the table's height in the cell file is wrong (POSE_MISMATCH).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import DepthModel
from pomona.drivers.interfaces import Frame, Intrinsics, Workspace
from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.later import Later

fft: Any = Later("scipy.fft")

cv2: Any = Later("cv2")

LARGEST_TILT = np.radians(20.0)  # greatest angle between the expected table and the seen one [rad]
HEIGHT = 0.010
TILT = np.radians(1.5)
"""Tolerances of a sound cell [m, rad]: calibration, levelling, arm. At 0.6 m a tilt of 1.5° moves a fruit by 16 mm."""
COLUMNS = 80  # pixels of a row that are used; 4800 of an image of 4:3
FARTHEST = 2.0  # depth beyond this is not used [m]: noise grows with its square
LEAST_POINTS = 300
LEAST_SHARE = 0.35
LEAST_SPREAD = 0.04
"""A plane counts as the table with this number of points, this ratio of all points within reach, and this standard
deviation of its points along its shorter side [m]."""
AROUND = 0.02
"""Points this near to a fixed box, or above it, are not on the table [m]: a crate's floor and its fruit lie level."""
DRAWS = 96  # triples of points that are tried; with a third of the points on the table one in 27 hits it


@dataclass(frozen=True, slots=True)
class SeenTable:
    """The table as the depth image shows it."""

    height: float  # of its middle above the expected plane, negative below [m]
    tilt: float  # angle between both planes [rad]
    distance: float  # of its middle from the camera along the optical axis [m]
    points: int  # number of depth pixels that lie on it, of those that were used
    allowed: float  # height that a sound cell may show at this distance [m]
    height_ratio: (
        float  # error of the depth, of itself, that would show a level table at this height
    )
    planes: Float64  # the seen plane and the expected one in the camera frame, as `Plane` has them, shape (2, 4)

    @property
    def deviation(self) -> float:
        """The larger of height and tilt, each in units of its tolerance."""
        return float(max(abs(self.height) / self.allowed, self.tilt / TILT))

    @property
    def sound(self) -> bool:
        """True within the tolerances of a sound cell."""
        return self.deviation <= 1.0

    @property
    def sentence(self) -> str:
        """Measured and allowed values."""
        side = "above" if self.height > 0.0 else "below"
        return (
            f"the depth image shows the table {1e3 * abs(self.height):.0f} mm {side} the cell file's height and tilted "
            f"by {np.degrees(self.tilt):.1f}° (allowed: {1e3 * self.allowed:.0f} mm, {np.degrees(TILT):.1f}°)"
        )


def depth_points(depth: NDArray[np.float32], intrinsics: Intrinsics) -> Float64:
    """Return points of a grid of `COLUMNS` columns in the camera frame, shape (n, 3) [m], without missing ones."""
    step = max(1, intrinsics.width // COLUMNS)
    z = depth[::step, ::step].astype(np.float64)
    v, u = np.indices(z.shape) * step
    used = (z > 0.0) & (z < FARTHEST)
    x = (u - intrinsics.cx) / intrinsics.fx * z
    y = (v - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x[used], y[used], z[used]], axis=1)


def view_table(
    points: Float64, T_base_camera: Float64, table_z: float, lens: Intrinsics, errs: DepthModel
) -> SeenTable | None:
    """Find the table, at height table_z in the base frame [m], among points of the camera frame, shape (n, 3) [m].

    None where no plane near the expected one is large enough to be the table. `points`: see `depth_points`.
    """
    normal = T_base_camera[2, :3]
    offset = float(T_base_camera[2, 3] - table_z)
    height = points @ normal + offset
    within = (
        np.abs(height) <= 0.12
    )  # greatest distance from the expected table at which the seen one is searched [m]
    if np.count_nonzero(within) < LEAST_POINTS:
        return None
    points = points[within]
    height = height[within]
    # Distance from a plane within which a point lies on it, or three deviations of its noise where these are more [m]
    band = np.maximum(4e-3, 3.0 * errs.deviation(points[:, 2], lens.fx))
    near = np.abs(height) <= HEIGHT + band
    plane = _refined(points, band, near) if near.mean() >= LEAST_SHARE else None
    if plane is None or not _is_table(points, band, plane):
        plane = _refined(points, band, _drawn(points, band, normal))
        if plane is None or not _is_table(points, band, plane):
            return None
    on_it = np.abs(points @ plane[0] + plane[1]) <= band
    middle = points[on_it].mean(axis=0)
    tilt = float(np.arccos(np.clip(plane[0] @ normal, -1.0, 1.0)))
    if tilt > LARGEST_TILT:
        return None
    distance = float(middle[2])
    # standard deviations of the depth's common error that the height may deviate in addition
    allowed = HEIGHT + 2.0 * errs.of_the_whole(distance) * distance
    seen = float(middle @ normal)
    planes = np.array([[*plane[0], plane[1]], [*normal, offset]])
    return SeenTable(
        seen + offset, tilt, distance, int(on_it.sum()), allowed, -(seen + offset) / offset, planes
    )


Plane = tuple[
    Float64, float
]  # unit normal towards the camera, shape (3,), and offset [m]: normal · p + offset = 0


def _refined(points: Float64, band: Float64, chosen: NDArray[np.bool_]) -> Plane | None:
    """Return the least-squares plane of the chosen points, and then of those in its band."""
    plane = None
    for _ in range(4):
        if np.count_nonzero(chosen) < LEAST_POINTS // 3:
            return None
        weight = 1.0 / band[chosen] ** 2
        centre = weight @ points[chosen] / weight.sum()
        spread = points[chosen] - centre
        normal = np.linalg.eigh((spread * weight[:, None]).T @ spread)[1][:, 0]
        normal = -normal if normal @ centre > 0.0 else normal
        plane = normal, -float(normal @ centre)
        chosen = np.abs(points @ plane[0] + plane[1]) <= band
    return plane


def _drawn(points: Float64, band: Float64, expected: Float64) -> NDArray[np.bool_]:
    """Return points on the best of `DRAWS` planes through three points, of those about parallel to the expected one."""
    triples = points[np.random.default_rng(0).integers(len(points), size=(DRAWS, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-6] / length[length > 1e-6, None]
    origins = triples[length > 1e-6, 0]
    level = np.abs(normals @ expected) > np.cos(LARGEST_TILT)
    normals = normals[level]
    origins = origins[level]
    away = np.abs(points @ normals.T - np.sum(normals * origins, axis=1)) <= band[:, None]
    if not away.shape[1]:
        return np.zeros(len(points), np.bool_)
    best: NDArray[np.bool_] = away[:, int(away.sum(axis=0).argmax())]
    return best


def _is_table(points: Float64, band: Float64, plane: Plane) -> bool:
    on_it = np.abs(points @ plane[0] + plane[1]) <= band
    if np.count_nonzero(on_it) < LEAST_POINTS or on_it.mean() < LEAST_SHARE:
        return False
    spread = points[on_it] - points[on_it].mean(axis=0)
    shorter = float(np.sqrt(np.linalg.eigvalsh(spread.T @ spread / len(spread))[1]))
    return shorter >= LEAST_SPREAD


def frame_points(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> Float64:
    """Return the `depth_points` beside the cell's fixed obstacles, in the camera frame, shape (n, 3) [m]."""
    assert frame.depth is not None
    points = depth_points(frame.depth, frame.intrinsics)
    return points[_beside(points @ T_base_camera[:3, :3].T + T_base_camera[:3, 3], workspace)]


def _beside(points: Float64, workspace: Workspace) -> NDArray[np.bool_]:
    """Return which points of the base frame, shape (n, 3), are neither near a fixed obstacle nor above it, (n,)."""
    beside = np.ones(len(points), np.bool_)
    for box in workspace.obstacles:
        in_box = (points - box.T_base_box[:3, 3]) @ box.T_base_box[:3, :3]
        in_box[:, 2] = np.minimum(in_box[:, 2], 0.0)  # boxes are turned about z only
        beside &= (np.abs(in_box) > np.array(box.half_extents) + AROUND).any(axis=1)
    for hull in workspace.hulls:
        lower = hull.points.min(axis=0) - AROUND
        upper = hull.points.max(axis=0) + AROUND
        beside &= (points < lower).any(axis=1) | (points > upper)[:, :2].any(axis=1)
    return beside


def frame_view(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> SeenTable | None:
    """Return the table in a frame; None without depth or a table, or where it is not in view."""
    if frame.depth is None or workspace.table_z is None or not frame.placed:
        return None
    points = frame_points(frame, T_base_camera, workspace)
    return view_table(points, T_base_camera, workspace.table_z, frame.intrinsics, frame.depth_model)


def should_show_table(frame: Frame, T_base_camera: Float64, workspace: Workspace) -> bool:
    """Return True where the table should fill most of the image, by the camera's stated pose."""
    if frame.depth is None or workspace.table_z is None or not frame.placed:
        return False
    lens = frame.intrinsics
    normal = T_base_camera[2, :3]
    u, v = np.meshgrid(np.linspace(0, lens.width - 1, 16), np.linspace(0, lens.height - 1, 12))
    rays = np.stack(
        [(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones_like(u)], axis=-1
    ).reshape(-1, 3)
    above = float(T_base_camera[2, 3] - workspace.table_z)
    falling = -(rays @ normal)
    hits = rays[falling > 1e-6] * (above / falling[falling > 1e-6])[:, None]
    hits = (
        hits[(hits[:, 2] > 0.0) & (hits[:, 2] < FARTHEST)] @ T_base_camera[:3, :3].T
        + T_base_camera[:3, 3]
    )
    inside = ((hits >= workspace.lower) & (hits <= workspace.upper))[:, :2].all(axis=1) & _beside(
        hits, workspace
    )
    # share of the image's rays that meet the table inside the workspace, where it should be seen
    return bool(inside.sum() >= 0.6 * len(rays))


WIDTH = 320  # width at which it is looked for [px]: leaves and branches are still there
SMOOTH = 1.5  # standard deviation by which both are smoothed [px of `WIDTH`]

# score of depth that belongs to colour: right frames have 9.8 (simulated) to 23 (orchard)
SURE = 8.0


VARIANTS = {
    "is mirrored left to right": (slice(None), slice(None, None, -1)),
    "is mirrored top to bottom": (slice(None, None, -1), slice(None)),
    "is turned by 180°": (slice(None, None, -1), slice(None, None, -1)),
}

Complex = NDArray[np.complex64]


def depth_elsewhere(frame: Frame, or_nowhere: bool = False) -> str:
    """Describe the misregistration of depth that fits better shifted, mirrored or turned; else empty.

    `or_nowhere` also reports depth that fits nowhere, as a view of few things does at times.
    """
    if frame.depth is None or not frame.depth.any():
        return ""
    colour = _of_colour(frame.colour)
    edges = _of_depth(frame.depth)
    here, elsewhere, shift = _scores(colour, edges)
    if here == elsewhere >= SURE:
        return ""
    found = [(elsewhere, _lies(shift, frame.depth.shape[1] / WIDTH))]
    for words, turned in VARIANTS.items():
        found.append(
            (_scores(colour, _of_depth(np.ascontiguousarray(frame.depth[turned])))[1], words)
        )
    score, words = max(found)
    if score >= SURE and here < 0.5 * score:
        return f"depth {words} against colour"
    # minimum ratio of the picture with depth edges for the conclusion that they match no colour edges
    telling = float(np.abs(edges).mean()) >= 0.02 and score > 0.0
    # Score below which the edges disagree everywhere: moved beyond the overlap, the orchard's depth scores 4.6 at most
    return (
        "depth's edges lie nowhere on colour's"
        if or_nowhere and telling and max(here, score) < 5.0
        else ""
    )


def _lies(shift: tuple[int, int], scale: float) -> str:
    """Return words for depth that a shift (right, down) [px of `WIDTH`] would bring onto colour."""
    names = ("left" if shift[0] > 0 else "right"), ("up" if shift[1] > 0 else "down")
    ways = (
        f"{abs(pixels) * scale:.0f} px {name}"
        for pixels, name in zip(shift, names, strict=True)
        if pixels
    )
    return f"lies {' and '.join(ways)}"


def _size(shape: tuple[int, ...]) -> tuple[int, int]:
    return WIDTH, max(1, round(shape[0] * WIDTH / shape[1]))


def _of_colour(colour: UInt8) -> Complex:
    """Directions of the colour's gradient, of the channel that changes the most."""
    small = cv2.GaussianBlur(
        cv2.resize(colour, _size(colour.shape), interpolation=cv2.INTER_AREA).astype(np.float32),
        (0, 0),
        SMOOTH,
    )
    x, y = (np.asarray(cv2.Sobel(small, cv2.CV_32F, *order)) / 8.0 for order in ((1, 0), (0, 1)))
    most = np.argmax(x**2 + y**2, axis=2)[..., np.newaxis]
    x, y = (np.take_along_axis(each, most, axis=2)[..., 0] for each in (x, y))
    return _directions(x, y, float(np.median(np.hypot(x, y))) + 1e-3)


def _of_depth(depth: Float32) -> Complex:
    """Return the directions of the gradient of inverse depth; missing depth counts as far away."""
    small = cv2.resize(depth, _size(depth.shape), interpolation=cv2.INTER_NEAREST)
    inverse = np.where(small > 0.0, 1.0 / np.maximum(small, 0.2), 0.0).astype(np.float32)
    smooth = cv2.GaussianBlur(inverse, (0, 0), SMOOTH)
    x, y = (np.asarray(cv2.Sobel(smooth, cv2.CV_32F, *order)) / 8.0 for order in ((1, 0), (0, 1)))
    return _directions(
        x, y, 0.03
    )  # change of inverse depth that counts half as an edge [1/m per pixel of `WIDTH`]


def _directions(x: NDArray[Any], y: NDArray[Any], faint: float) -> Complex:
    """Unit vectors of twice the angle, so that light to dark is as good as dark to light; shorter where it is faint."""
    doubled: Complex = ((x + 1j * y) ** 2 / (x**2 + y**2 + faint**2)).astype(np.complex64)
    return doubled


def _scores(colour: Complex, depth: Complex) -> tuple[float, float, tuple[int, int]]:
    """Return the score of depth without or with a small shift, the best score, and its shift (right, down) [px]."""
    height, width = colour.shape
    size = 2 * height, 2 * width
    agree = fft.ifft2(fft.fft2(colour, size) * np.conj(fft.fft2(depth, size))).real
    ones = np.ones(colour.shape, np.float32)
    weight = fft.irfft2(fft.rfft2(ones, size) * np.conj(fft.rfft2(np.abs(depth), size)), size)
    # of the depth's edges that a shift must leave in the picture
    there = weight > 0.6 * max(float(np.abs(depth).sum()), 1e-6)
    mean: Float64 = np.where(there, agree / np.sqrt(np.maximum(weight, 1.0)), -np.inf)
    spread = float(mean[there].std()) if there.any() else 0.0
    if spread < 1e-9:
        return 0.0, 0.0, (0, 0)
    score = (mean - np.median(mean[there])) / spread
    # Registered depth may lie so far beside colour: a share of the picture's width (12 of 1920 px in the orchard)
    beside = int(np.ceil(0.01 * width))
    near = float(np.roll(score, (beside, beside), (0, 1))[: 2 * beside + 1, : 2 * beside + 1].max())
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    right, down = (
        int((at + half) % (2 * half) - half) for at, half in ((column, width), (row, height))
    )
    return near, float(score.max()), (right, down)


POSE_MISMATCH = "POSE_MISMATCH"
DEPTH_MISMATCH = "DEPTH_MISMATCH"
MISMATCHES = (POSE_MISMATCH, DEPTH_MISMATCH)  # failure codes of every skill that checks its frames

FLIPS = {"left to right": (-1.0, 1.0), "top to bottom": (1.0, -1.0)}
"""How mirrored depth is mirrored back: factors of the image's columns and rows."""


@dataclass(frozen=True, slots=True)
class FrameProblem:
    """A statement of a frame that cannot be true."""

    code: str  # POSE_MISMATCH or DEPTH_MISMATCH
    message: str  # measured and allowed values, and the remedy
    data: Mapping[str, float] = field(default_factory=dict)  # the same as numbers
    planes: Float64 | None = None  # `SeenTable.planes` of a POSE_MISMATCH


def frame_problem(
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    earlier: Sequence[tuple[float, Float64]] = (),
) -> FrameProblem | None:
    """Return the implausible part of a frame, or None, for the camera's stated pose, shape (4, 4).

    `earlier` are times [s] and poses of the camera at earlier frames, oldest first.
    """
    view = frame_view(frame, T_base_camera, workspace)
    missing = view is None and should_show_table(frame, T_base_camera, workspace)
    doubted = missing or (view is not None and not view.sound)
    beside = depth_elsewhere(frame, or_nowhere=doubted) if frame.colour.any() else ""
    if not doubted:
        words = f"{beside}: the depth image is not registered to colour, or of another moment"
        return (
            FrameProblem(DEPTH_MISMATCH, f"{words}; check the camera's driver") if beside else None
        )
    deviation = np.inf if view is None else view.deviation
    if wrong := _other_depth(frame, T_base_camera, workspace, deviation, earlier) or beside:
        shown = "the depth image does not show the table" if view is None else view.sentence
        return FrameProblem(
            DEPTH_MISMATCH, f"{wrong}: {shown}; check the camera's driver", _data(view)
        )
    return None if view is None else pose_problem(view)


def pose_problem(view: SeenTable) -> FrameProblem | None:
    """Return the problem of a table that is not where the cell file has it, or None."""
    if view.sound:
        return None
    ratio = view.height_ratio
    scale = f"; depth that is {100.0 * abs(ratio):.1f} % too {'long' if ratio > 0.0 else 'short'} does the same"
    return FrameProblem(
        POSE_MISMATCH,
        f"{view.sentence}; the camera's pose or the table's height in the cell file is wrong"
        f"{scale if view.tilt < 0.5 * TILT else ''}. "
        "Measure the table, or run `pomona calibrate hand-eye` or `pomona calibrate depth`",
        _data(view),
        view.planes,
    )


def _other_depth(
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    off: float,
    earlier: Sequence[tuple[float, Float64]],
) -> str:
    """Return words for depth of another moment, mirrored or too long, where it explains the table's place; or ""."""
    assert frame.depth is not None
    assert workspace.table_z is not None
    table_z = workspace.table_z
    lens = frame.intrinsics
    errs = frame.depth_model
    points = depth_points(frame.depth, lens)
    # another explanation counts where it fits this much better: the ratio of both deviations, in tolerances
    best = 0.5 * off
    words = ""
    for name, signs in FLIPS.items():
        centre = np.array([lens.width - 1 - 2.0 * lens.cx, lens.height - 1 - 2.0 * lens.cy]) / (
            lens.fx,
            lens.fy,
        )
        flipped = points.copy()
        for axis, sign in enumerate(signs):
            if sign < 0.0:
                flipped[:, axis] = centre[axis] * points[:, 2] - points[:, axis]
        seen = view_table(flipped, T_base_camera, table_z, lens, errs)
        if seen is not None and seen.sound and seen.deviation < best:
            best = seen.deviation
            words = f"depth is mirrored {name}"
    for stamp, T in earlier:
        seen = view_table(points, T, table_z, lens, errs)
        if seen is not None and seen.sound and seen.deviation < best:
            best = seen.deviation
            words = (
                f"depth is {frame.stamp - stamp:.2f} s old, and fits the camera's pose of that time"
            )
    ratio = (
        float(np.median(points @ T_base_camera[2, :3])) / (table_z - T_base_camera[2, 3])
        if len(points)
        else 0.0
    )
    scaled = (
        view_table(points / ratio, T_base_camera, table_z, lens, errs)
        if np.isinf(off) and ratio > 1.1
        else None
    )
    if (
        not words and scaled is not None and scaled.sound
    ):  # a thing may lie above the table; below it none does
        words = f"depth is {ratio:.2f} times as long as the table's height and the camera's pose make it"
    return words


def _data(view: SeenTable | None) -> dict[str, float]:
    if view is None:
        return {}
    data = {
        "height_m": view.height,
        "tilt_rad": view.tilt,
        "allowed_m": view.allowed,
        "allowed_rad": float(TILT),
    }
    return {name: round(value, 4) for name, value in data.items()}
