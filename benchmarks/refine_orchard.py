"""Refine on real fruit: calipered apples in two RGB-D frames of an orchard row.

The folder holds FRAME_depth_mm.png (registered to colour, uint16, 0 = none), FRAME_mask.png and fruit.csv with a box
and the calipered calibre and height per fruit. The start pose is an upright model that fills the labelled box. Such a
sensor's depth on fruit has a bias that nobody explains: read the raw error beside the leave-one-fruit-out one, in which
a straight line between measured and calipered size is fitted to all other fruit.
"""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from drivers.interfaces import Intrinsics
from executive.values.arrays import Float64
from skills.geometry import transform
from skills.perception.fruit import FruitModel
from skills.perception.refinement import Limits, refine
from skills.perception.refinement.errors import RefineError

KINECT = Intrinsics(917.12, 916.97, 957.72, 550.79, 1920, 1080)
LITERATURE_MM = 2.93
"""Mean error of the diameter from RGB-D in the literature, fruit at least 60 % visible."""


def orchard_errors(folder: Path, fruit: FruitModel, console: Console) -> dict[str, object]:
    """Mean absolute errors of the calibre, raw and calibrated on all other fruit."""
    with (folder / "fruit.csv").open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if not row["fruit_id"].startswith("BALL")]
    depth = {
        name: np.asarray(cv2.imread(str(folder / f"{name}_depth_mm.png"), cv2.IMREAD_UNCHANGED), np.float32) / 1e3
        for name in {row["frame"] for row in rows}
    }
    table = Table("method", "fruit", "measured", "raw bias", "raw MAE", "leave-one-out MAE", "of the calibre")
    table.title = f"calibre of real apples in mm; {LITERATURE_MM} mm in the literature (>= 60 % visible)"
    figures: dict[str, object] = {}
    for method in ("uniform", "shape"):
        for group in ("not occluded", "all"):
            chosen = [row for row in rows if group == "all" or row["lab.occluded"] == "NO"]
            measured = np.array([_calibre(row, depth[row["frame"]], fruit, method) for row in chosen])
            known = np.isfinite(measured)
            estimate = measured[known]
            true = np.array([float(row["lab.o_caliber_mm"]) for row in chosen])[known]
            names = np.array([row["fruit_id"] for row in chosen])[known]
            raw = estimate - true
            left_out = np.concatenate([_left_out(estimate, true, names == name) for name in np.unique(names)])
            values = (raw.mean(), np.abs(raw).mean(), np.abs(left_out).mean())
            table.add_row(
                method, group, f"{len(true)} of {len(chosen)}", f"{values[0]:+.2f}", f"{values[1]:.2f}",
                f"{values[2]:.2f}", f"{100.0 * values[2] / true.mean():.1f} %",
            )  # fmt: skip
            figures[f"{method}, {group}"] = dict(zip(("bias", "raw", "left_out"), map(float, values), strict=True))
    console.print(table)
    return figures


def _calibre(row: dict[str, str], depth: NDArray[np.float32], fruit: FruitModel, method: str) -> float:
    """The larger horizontal dimension of one fruit [mm]; NaN where Refine refuses."""
    x, y, w, h = (float(row[key]) for key in "xywh")
    centre = np.array([(x + 0.5 * w - KINECT.cx) / KINECT.fx, (y + 0.5 * h - KINECT.cy) / KINECT.fy, 1.0])
    distance = KINECT.fx * np.sqrt(fruit.dimensions[0] * fruit.dimensions[1] / (w * h))
    try:
        result = refine(
            depth, KINECT, transform(translation=centre * distance), fruit, method=method,  # type: ignore[arg-type]
            limits=Limits(inlier_band=8e-3), using="zbuffer",
        )  # fmt: skip
    except RefineError:
        return float("nan")
    return 1e3 * float(max(result.dimensions[0], result.dimensions[2]))


def _left_out(estimate: Float64, true: Float64, out: NDArray[np.bool_]) -> Float64:
    """Errors of some fruit after a straight line fitted to the others."""
    slope, offset = np.polyfit(estimate[~out], true[~out], 1)
    errors: Float64 = slope * estimate[out] + offset - true[out]
    return errors
