"""Refine on real fruit: calipered apples in two RGB-D frames of an orchard row.

The folder holds FRAME_color.jpg, FRAME_depth_mm.png (registered to colour, uint16, 0 = none) and fruit.csv with a box
and the calipered calibre and height per fruit. Two starts: an upright model that fills the labelled box, and the
detector's find, as in `pomona measure`. Errors are raw, and leave-one-fruit-out: after a straight line fitted to all
other fruit, and with the sizes of the kind learnt from all other fruit.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from pomona.devices.frames.camera import LEVEL
from pomona.devices.frames.folder import list_frames
from pomona.drivers.depth_model import AZURE_KINECT
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.executive.values.pictures import read_plane
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.detection import Detection, DetectorOptions
from pomona.skills.perception.fruit import FruitModel
from pomona.skills.perception.fruit.sizes import KindSizes, learn_sizes
from pomona.skills.perception.refinement import (
    DepthLook,
    FruitContext,
    Limits,
    RefineResult,
    render_depth,
)
from pomona.skills.perception.refinement.errors import NoDepth, RefineError
from pomona.skills.perception.refinement.measure import refine, size_deviation
from pomona.skills.shared.looking import find_in_frame

KINECT = Intrinsics(917.12, 916.97, 957.72, 550.79, 1920, 1080)
LITERATURE_MM = 2.93
"""Mean error of the diameter from RGB-D in the literature, fruit at least 60 % visible."""


def orchard_errors(folder: Path, fruit: FruitModel, console: Console) -> dict[str, object]:
    """Mean absolute errors of the calibre, raw and calibrated on all other fruit."""
    with (folder / "fruit.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if not row["fruit_id"].startswith("BALL")]
    depth = {
        name: np.asarray(read_plane(folder / f"{name}_depth_mm.png"), np.float32) / 1e3
        for name in {row["frame"] for row in rows}
    }
    table = Table(
        "method", "fruit", "measured", "raw bias", "raw MAE", "leave-one-out MAE", "of the calibre"
    )
    table.title = (
        f"calibre of real apples in mm; {LITERATURE_MM} mm in the literature (>= 60 % visible)"
    )
    figures: dict[str, object] = {}
    for method in ("uniform", "shape"):
        for group in ("not occluded", "all"):
            chosen = [row for row in rows if group == "all" or row["lab.occluded"] == "NO"]
            measured = np.array(
                [_calibre(row, depth[row["frame"]], fruit, method) for row in chosen]
            )
            known = np.isfinite(measured)
            estimate = measured[known]
            true = np.array([float(row["lab.o_caliber_mm"]) for row in chosen])[known]
            names = np.array([row["fruit_id"] for row in chosen])[known]
            raw = estimate - true
            left_out = np.concatenate(
                [_left_out(estimate, true, names == name) for name in np.unique(names)]
            )
            values = (raw.mean(), np.abs(raw).mean(), np.abs(left_out).mean())
            table.add_row(
                method, group, f"{len(true)} of {len(chosen)}", f"{values[0]:+.2f}", f"{values[1]:.2f}",
                f"{values[2]:.2f}", f"{100.0 * values[2] / true.mean():.1f} %",
            )  # fmt: skip
            figures[f"{method}, {group}"] = dict(
                zip(("bias", "raw", "left_out"), map(float, values), strict=True)
            )
    console.print(table)
    return figures


def _calibre(
    row: dict[str, str], depth: NDArray[np.float32], fruit: FruitModel, method: str
) -> float:
    """The larger horizontal dimension of one fruit [mm]; NaN where Refine refuses."""
    x, y, w, h = (float(row[key]) for key in "xywh")
    centre = np.array(
        [(x + 0.5 * w - KINECT.cx) / KINECT.fx, (y + 0.5 * h - KINECT.cy) / KINECT.fy, 1.0]
    )
    drawn_out = np.sqrt(
        np.hypot(1.0, centre[0]) * np.hypot(1.0, centre[1])
    )  # a ball off the axis is no circle
    distance = KINECT.fx * np.sqrt(fruit.dimensions[0] * fruit.dimensions[1] / (w * h)) * drawn_out
    try:
        result = refine(
            DepthLook(depth, KINECT, AZURE_KINECT, renderer="zbuffer"),
            transform(translation=centre * distance),
            fruit,
            method=method,
            limits=Limits(inlier_band=8e-3),
        )
    except RefineError:
        return float("nan")
    return 1e3 * float(max(result.dimensions[0], result.dimensions[2]))


def _left_out(estimate: Float64, true: Float64, out: NDArray[np.bool_]) -> Float64:
    """Errors of some fruit after a straight line fitted to the others."""
    slope, offset = np.polyfit(estimate[~out], true[~out], 1)
    errors: Float64 = slope * estimate[out] + offset - true[out]
    return errors


# ---------------------------------------------------------------------------------------------- what is found

WORKING_WIDTH = 1280
LEAST_SCORE = 0.5
OVERLAP = 0.5
SURELY = 1.645
"""Standard deviations of a 90 % interval."""


@dataclass(frozen=True, slots=True, eq=False)
class Find:
    """A find that is a labelled fruit: its name, true width and height [m], and the measured ones."""

    name: str
    occluded: bool
    true: Float64
    detection: Detection
    depth: NDArray[np.float32]

    @property
    def sine(self) -> float:
        """Of the angle between the line of sight and the stem's axis."""
        T = self.detection.T_camera_object
        return float(np.linalg.norm(np.cross(T[:3, 3] / np.linalg.norm(T[:3, 3]), T[:3, 1])))

    def measured(self, fruit: FruitModel, sizes: KindSizes | None = None) -> RefineResult:
        """Measure as `pomona measure` does."""
        look = DepthLook(self.depth, KINECT, AZURE_KINECT, renderer="zbuffer")
        known = FruitContext(sizes=sizes, size_deviation=size_deviation(self.detection))
        return refine(look, self.detection.T_camera_object, fruit, method="uniform", known=known)


def found_errors(folder: Path, fruit: FruitModel, console: Console) -> dict[str, object]:
    """Errors of width and height of the detector's finds, and how often stated 90 % intervals hold."""
    with (folder / "fruit.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    finds: list[Find] = []
    counts = {"found": 0, "with depth": 0, "measured": 0}
    for frame in list_frames(folder):
        colour, depth = frame.read(KINECT)
        look = Frame(0.0, 0, colour, depth, KINECT, None, LEVEL, frame.label, AZURE_KINECT)
        labelled = [
            row
            for row in rows
            if row["frame"] == frame.label and not row["fruit_id"].startswith("BALL")
        ]
        for found in _detections(look, fruit):
            counts["found"] += 1
            find = Find("", False, np.full(2, np.nan), found, depth)
            try:
                find.measured(fruit)
                counts["with depth"] += 1
                counts["measured"] += 1
            except NoDepth:
                continue
            except RefineError:
                counts["with depth"] += 1
                continue
            row = max(labelled, key=lambda row: _overlap(row, found))
            if _overlap(row, found) >= OVERLAP:
                true = (
                    np.array([float(row["lab.o_caliber_mm"]), float(row["lab.o_height_mm"])]) / 1e3
                )
                finds.append(
                    Find(row["fruit_id"], row["lab.occluded"] == "YES", true, found, depth)
                )
    table = Table("sizes", "fruit", "finds", "bias", "MAE", "90 % intervals hold")
    table.title = "width / height of the detector's finds on real frames, in mm"
    figures: dict[str, object] = dict(counts)
    for name, results in (
        ("as the model", _alone(finds, fruit)),
        ("learnt from others", _learnt(finds, fruit)),
    ):
        sizes = np.array([r.dimensions[[0, 1]] for r in results])
        stated = np.array([np.sqrt(np.diag(r.covariance)[[3, 4]]) for r in results])
        error = sizes - [f.true for f in finds]
        for group in ("not occluded", "all"):
            of = np.array([group == "all" or not f.occluded for f in finds])
            bias, mae = 1e3 * error[of].mean(axis=0), 1e3 * np.abs(error[of]).mean(axis=0)
            hold = (np.abs(error[of]) <= SURELY * stated[of]).mean(axis=0)
            table.add_row(
                name, group, str(of.sum()), f"{bias[0]:+.1f} / {bias[1]:+.1f}", f"{mae[0]:.2f} / {mae[1]:.2f}",
                f"{hold[0]:.0%} / {hold[1]:.0%}",
            )  # fmt: skip
            figures[f"{name}, {group}"] = {
                "bias": bias.tolist(),
                "mae": mae.tolist(),
                "hold": hold.tolist(),
            }
    console.print(table)
    console.print(", ".join(f"{count} {what}" for what, count in counts.items()))
    return figures


def _detections(look: Frame, fruit: FruitModel) -> Iterator[Detection]:
    options = DetectorOptions(working_width=WORKING_WIDTH, most_fruit=100)
    for k, found in enumerate(find_in_frame(look, fruit, options)):
        if (
            found.score >= LEAST_SCORE
            and found.T_camera_object is not None
            and found.covariance is not None
        ):
            yield Detection(
                fruit,
                look,
                LEVEL,
                found.T_camera_object,
                found.keypoints,
                found.score,
                found.covariance,
                k,
                0,
            )


def _overlap(row: dict[str, str], found: Detection) -> float:
    """Intersection over union of a labelled box and of the box around the model as found."""
    seen, box = render_depth(found.fruit, found.T_camera_object, KINECT, using="zbuffer")
    rows, columns = np.flatnonzero((seen > 0).any(axis=1)), np.flatnonzero((seen > 0).any(axis=0))
    left, top = box.left + columns[0], box.top + rows[0]
    right, bottom = box.left + columns[-1] + 1, box.top + rows[-1] + 1
    x, y, w, h = (float(row[key]) for key in "xywh")
    wide, high = min(right, x + w) - max(left, x), min(bottom, y + h) - max(top, y)
    both = max(wide, 0.0) * max(high, 0.0)
    return float(both / ((right - left) * (bottom - top) + w * h - both))


def _alone(finds: list[Find], fruit: FruitModel) -> list[RefineResult]:
    return [find.measured(fruit) for find in finds]


def _learnt(finds: list[Find], fruit: FruitModel) -> list[RefineResult]:
    """Each fruit with its kind's sizes as all other fruit teach them."""
    proportion = float(fruit.dimensions[1] / fruit.dimensions[[0, 2]].mean())
    shown = np.array([result.dimensions[[0, 2]].mean() for result in _alone(finds, fruit)])
    deviations = np.array([size_deviation(f.detection) for f in finds])
    sines = np.array([f.sine for f in finds])
    true = np.array([f.true for f in finds])
    names = np.array([f.name for f in finds])
    found = []
    for find in finds:
        others = names != find.name
        sizes = learn_sizes(
            true[others], shown[others], deviations[others], sines[others], proportion
        )
        found.append(find.measured(fruit, sizes=sizes))
    return found
