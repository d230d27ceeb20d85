"""Measured fruit beside calipers: which find is which fruit, errors, and the sizes of the kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from pomona.applications.inventory.fruit_table import Z_90
from pomona.applications.inventory.measured_frame import FruitInFrame
from pomona.executive import Float64, NoTableError, read_table
from pomona.skills.perception import (
    KindSizes,
    MeasuredFruit,
    held_out,
    learn_sizes,
    size_deviation,
)

COLUMNS = ("frame", "name", "x", "y", "w", "h", "width_mm", "height_mm")

OVERLAP = 0.5
"""Least intersection over union of a labelled box and a find of the same fruit."""

MOST_TIMES = 2.0
"""Calipers and a camera that differ by this factor (median) measure different things or units."""


class UnusableCalipers(ValueError):
    """A table of calipers that cannot be read, or does not fit the frames."""


@dataclass(frozen=True, slots=True, eq=False)
class CaliperedFruit:
    """One fruit in one frame, as labelled and measured by hand.

    Attributes:
        name: of the fruit, the same in all frames that show it.
        box: left, top, right, bottom [px].
        size: width and height, shape (2,) [m].
    """

    frame: str
    name: str
    box: tuple[float, float, float, float]
    size: Float64


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A fruit that was both measured and calipered."""

    fruit: FruitInFrame
    measured: MeasuredFruit
    true: CaliperedFruit

    @property
    def error(self) -> Float64:
        """Of width and height, shape (2,) [m]."""
        error: Float64 = self.measured.dimensions[:2] - self.true.size
        return error

    @property
    def shown(self) -> float:
        """Width of the model as it was scaled [m]."""
        return self.measured.mu * float(self.measured.fruit.dimensions[[0, 2]].mean())

    @property
    def sine(self) -> float:
        """Of the angle between the line of sight and the stem's axis."""
        T = self.measured.T_base_fruit
        sight = T[:3, 3] - self.measured.T_base_camera[:3, 3]
        return float(np.linalg.norm(np.cross(sight, T[:3, 1])) / np.linalg.norm(sight))


def read_calipers(path: Path) -> list[CaliperedFruit]:
    """Return the fruit of a table. Raises UnusableCalipers: no table, a column is missing, or a value is no number."""
    try:
        rows = read_table(path, COLUMNS)
    except NoTableError as error:
        raise UnusableCalipers(f"{path}: {error}") from error
    fruit = []
    for line, row in rows:
        x, y, w, h, width, height = (_number(path, line, row, key) for key in COLUMNS[2:])
        size = np.array([width, height]) / 1e3
        fruit.append(CaliperedFruit(row["frame"], row["name"], (x, y, x + w, y + h), size))
    return fruit


def _number(path: Path, line: int, row: dict[str, str], key: str) -> float:
    try:
        value = float(row[key])
    except (TypeError, ValueError):
        value = float("nan")
    if not np.isfinite(value) or (value <= 0.0 and key not in ("x", "y")):
        raise UnusableCalipers(f"{path}:{line}: {key} is {row[key]!r}: a number above 0 is needed")
    return value


def compare(fruit: Sequence[FruitInFrame], calipered: Sequence[CaliperedFruit]) -> list[Compared]:
    """Return the measured fruit that were calipered, by their boxes; the surest find of a fruit in a frame counts.

    Raises UnusableCalipers: no fruit fits, or the sizes are of other units.
    """
    compared: dict[int, Compared] = {}
    for each in fruit:
        if each.measured is None:
            continue
        for index, true in enumerate(calipered):
            same = true.frame == each.detection.frame.label and _overlap(each.box, true.box)
            if same >= OVERLAP:
                compared.setdefault(index, Compared(each, each.measured, true))
    if not compared:
        raise UnusableCalipers(
            "no measured fruit has its box in the table: do its frames and boxes fit?"
        )
    found = list(compared.values())
    ratio = float(np.median([each.true.size[0] / each.measured.dimensions[0] for each in found]))
    if not 1.0 / MOST_TIMES <= ratio <= MOST_TIMES:
        raise UnusableCalipers(
            f"width_mm is {ratio:.2g} times what the camera saw (median): check its unit"
        )
    return found


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """Return the intersection over union of two boxes: left, top, right, bottom."""
    wide = min(a[2], b[2]) - max(a[0], b[0])
    high = min(a[3], b[3]) - max(a[1], b[1])
    both = max(wide, 0.0) * max(high, 0.0)
    areas = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])
    return both / (areas - both)


def figures(compared: Sequence[Compared]) -> str:
    """Return the errors of width and height, and how often their 90 % intervals hold."""
    errors = 1e3 * np.array([each.error for each in compared])
    deviations = [np.sqrt(np.diag(each.measured.covariance)[[3, 4]]) for each in compared]
    hold = np.abs(errors) <= 1e3 * Z_90 * np.array(deviations)
    parts = [
        f"{name}: bias {errors[:, k].mean():+.1f} mm, mean error {np.abs(errors[:, k]).mean():.1f} mm, "
        f"90 % intervals hold {hold[:, k].mean():.0%}"
        for k, name in enumerate(("width", "height"))
    ]
    return "; ".join((f"{len(compared)} measured fruit beside calipers", *parts))


def learn(compared: Sequence[Compared]) -> tuple[KindSizes, str]:
    """Return the sizes of the kind, and the errors of each fruit with the sizes of the others as a sentence.

    Several looks at one fruit count as one. Raises TooFewFruit: the fruit do not give the spread of sizes.
    """
    model = compared[0].measured.fruit.dimensions
    proportion = float(model[1] / model[[0, 2]].mean())
    looks: dict[str, list[tuple[float, ...]]] = {}
    for each in compared:
        seen = each.shown, size_deviation(each.fruit.detection), each.sine
        looks.setdefault(each.true.name, []).append((*each.true.size, *seen))
    rows = np.array([np.mean(values, axis=0) for values in looks.values()])
    given = rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4], proportion
    sizes = learn_sizes(*given)
    width, height = 1e3 * np.abs(held_out(*given)).mean(axis=0)
    return sizes, (
        f"sizes of {len(rows)} fruit; each fruit with those of the others: mean error of width {width:.1f} mm, "
        f"of height {height:.1f} mm"
    )


def written(sizes: KindSizes) -> str:
    """Return the sizes as a fruit file includes them."""
    lines = [f"{field.name}: {getattr(sizes, field.name):.4f}" for field in fields(sizes)]
    lines[0] = f"width: {1e3 * sizes.width:.2f} mm"
    return "\n".join(lines) + "\n"
