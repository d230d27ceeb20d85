"""The table of measured fruit, as CSV and as JSON, and doubts about all of it."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.applications.inventory.measured_frame import FruitInFrame

Row = dict[str, str | float | None]
"""One fruit, by column: sizes and places in millimetres, `…_90_…`: half of the interval that holds 90 of 100 cases."""

Z_90 = 1.6449
"""Quantile of the normal distribution for an interval of 90 %, in standard deviations."""

FEW = 0.1
"""Share of measured fruit below which the depth is doubted: of two real frames it is 0.6."""

UNLIKE_MODEL = 0.5, 1.25
"""Median size of measured fruit over the model's that is usual: of 52 apples with calipers it is 0.73."""

LEAST_TELLING = 3
"""Least number of fruit for a doubt about all of them."""


def row_of(fruit: FruitInFrame, doubt: str) -> Row:
    """Return the row of a fruit; `doubt` is the reason why its frame may be wrong, or empty."""
    detection = fruit.detection
    measured = fruit.measured
    row: Row = {
        "frame": detection.frame.label,
        "row": fruit.number,
        "score": round(detection.score, 3),
        "visible": None if np.isnan(detection.visibility) else round(detection.visibility, 2),
    }
    for key, value in zip(("left", "top", "right", "bottom"), fruit.box, strict=True):
        row[f"{key}_px"] = round(value, 1)
    row |= dict.fromkeys(MEASURES)
    if measured is not None:
        place = measured.T_base_fruit[:3, 3]
        size = measured.dimensions
        values = 1e3 * np.concatenate([size, place])
        deviations = 1e3 * np.sqrt(np.diag(measured.covariance)[[3, 4, 5, 0, 1, 2]])
        for name, value, deviation in zip(LENGTHS, values, deviations, strict=True):
            row[f"{name}_mm"] = round(float(value), 1)
            row[f"{name}_90_mm"] = round(Z_90 * float(deviation), 1)
        mass = measured.mass
        if mass is not None:
            row["mass_g"], row["mass_90_g"] = round(1e3 * mass[0]), round(1e3 * Z_90 * mass[1])
        row["agreeing"], row["method"] = round(measured.inlier_ratio, 2), measured.method
    return row | {"not_measured": fruit.why, "doubt": doubt}


LENGTHS = ("width", "height", "depth", "x", "y", "z")
MEASURES = (
    *(f"{name}{part}_mm" for name in LENGTHS for part in ("", "_90")),
    "mass_g",
    "mass_90_g",
    "agreeing",
    "method",
)


def write_tables(rows: Sequence[Row], folder: Path) -> None:
    """Write `fruit.csv` and `fruit.json`. Raises OSError: a file cannot be written."""
    (folder / "fruit.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    with (folder / "fruit.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(rows[0]) if rows else ["frame", "row", *MEASURES])
        table.writeheader()
        table.writerows(rows)


def doubt_of_all(fruit: Sequence[FruitInFrame]) -> str:
    """Return why the sizes of all fruit may be wrong; empty without a reason."""
    measured = [each.measured for each in fruit if each.measured is not None]
    if len(fruit) >= LEAST_TELLING and len(measured) < FEW * len(fruit):
        return (
            f"{len(measured)} of {len(fruit)} fruit could be measured: is the depth in millimetres, registered to "
            "colour and of the same moment, and are the fruit as near as the camera measures?"
        )
    if len(measured) < LEAST_TELLING:
        return ""
    middle = float(np.median([each.mu for each in measured]))
    least, most = UNLIKE_MODEL
    if least <= middle <= most:
        return ""
    return (
        f"the {len(measured)} measured fruit look {middle:.2f} times as large as their model (median), {least:g} to "
        f"{most:g} is usual: do the intrinsics belong to these pictures, and is the depth right?"
    )
