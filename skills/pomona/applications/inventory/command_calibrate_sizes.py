"""`pomona calibrate sizes`: the distribution of sizes of a kind of fruit, from measured fruit."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive import Float64, NoTableError, read_table
from pomona.skills.perception import (
    LEAST_FRUIT,
    FruitError,
    KindSizes,
    TooFewFruit,
    held_out,
    learn_sizes,
    load_fruit,
)

TRUE = (
    "true_width_mm",
    "true_height_mm",
)  # columns that an operator adds to `finds.csv` for fruit measured by hand

_SEEN = "shown_mm", "shown_90_mm", "from_side"
_FRUIT = "fruit"
_BY_SHAPE = "width_mm", "width_90_mm", "height_mm", "height_90_mm"
_Z_90 = 1.6449

LEAST_KNOWN = (
    0.06  # relative uncertainty of a shape above which only the prior counts (52 calipered apples)
)


MOST_TIMES = (
    2.0  # a caliper and a camera that differ by this factor measure different things or units
)


MOST_UNLIKE = 0.12
"""Fruit that are high where their model is wide, by more than this share, were written into each other's columns: the
orchard's apples are 0.08 higher for their width than the model."""


class UnusableTable(ValueError):
    """A table that cannot be read, or lacks required columns."""


def add(kinds: Any) -> None:
    """Register `sizes` among the kinds of `pomona calibrate`."""
    sizes = kinds.add_parser(
        "sizes", help="estimate the sizes of a kind of fruit from measured fruit"
    )
    sizes.add_argument(
        "tables", type=Path, nargs="+", metavar="FINDS", help="finds.csv of pomona measure"
    )
    sizes.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    about = (
        "use the sizes of --method shape, where its depth separates height and width: no calipers"
    )
    sizes.add_argument("--by-shape", action="store_true", help=about)
    sizes.add_argument(
        "--out", type=Path, required=True, help="the file to write: `sizes: {include: FILE}`"
    )
    sizes.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Learn, try on fruit that were left out, write; returns 0, or 2 when the tables cannot be used."""
    try:
        if options.out.exists():
            raise UnusableTable(f"{options.out} is there already: name another file with --out")
        if not options.out.absolute().parent.is_dir():
            raise UnusableTable(f"{options.out}: there is no folder {options.out.parent}")
        fruit = load_fruit(options.fruit)
        proportion = float(fruit.dimensions[1] / fruit.dimensions[[0, 2]].mean())
        measured = read_measured(options.tables, options.by_shape)
        if not options.by_shape:
            _refuse_exchanged(measured, proportion, fruit.name)
        count, least = len(measured.sizes), LEAST_FRUIT + 1  # one is left out in turn
        if count < least:
            raise TooFewFruit(
                f"{count} measured fruit do not give the spread of sizes: measure {least} or more"
            )
        given = (
            measured.sizes,
            measured.shown,
            measured.deviations,
            measured.sines,
            proportion,
            measured.own,
        )
        learnt = learn_sizes(*given)
        before, after = held_out(*given)
        options.out.write_text(_written(learnt, measured), encoding="utf-8")
    except (UnusableTable, TooFewFruit, FruitError, OSError) as error:
        sys.stderr.write(f"pomona calibrate sizes: {error}\n")
        return 2
    sys.stdout.write(
        f"{len(measured.sizes)} fruit: width {1e3 * learnt.width:.1f} mm ± {learnt.width_deviation:.1%}, height over "
        f"width {learnt.height_over_width:.3f} ± {learnt.height_over_width_deviation:.1%}\n"
        f"mean error of width / height, each fruit with the sizes of the others: {_mm(after)} (their mean size: "
        f"{_mm(before)})\nwritten to {options.out}: `sizes: {{include: {options.out.name}}}` in fruit.yaml beside it\n"
    )
    return 0


@dataclass(frozen=True, slots=True, eq=False)
class SizeTable:
    """Fruit that were measured and seen, a row a fruit: the arguments of `learn_sizes`."""

    sizes: Float64
    shown: Float64
    deviations: Float64
    sines: Float64
    own: Float64


def read_measured(tables: Sequence[Path], by_shape: bool) -> SizeTable:
    """Return the fruit of tables of finds; several finds of one fruit are one row.

    Args:
        tables: as `pomona measure` writes them, with `TRUE` added where a fruit was measured by hand.
        by_shape: take the sizes that were fitted to the depth instead.

    Raises UnusableTable: no table, a column is missing or there twice, something is no number or in other units, or the
    calipers' sizes of one fruit contradict each other.
    """
    fruit: dict[tuple[str, str, str], list[list[float]]] = {}
    for table in tables:
        for line, row in _rows(table, (_FRUIT, *_SEEN, *(_BY_SHAPE if by_shape else TRUE))):
            values = _by_shape(table, line, row) if by_shape else _by_hand(table, line, row)
            if values is None:
                continue
            looks = fruit.setdefault(
                (str(table), row.get("scene") or "", row[_FRUIT] or str(line)), []
            )
            if looks and not by_shape:
                _agree(table, line, row, looks[0])
            looks.append(values)
    if not fruit:
        what = (
            "no row was measured by --method shape well enough"
            if by_shape
            else f"no row has {' and '.join(TRUE)}"
        )
        raise UnusableTable(f"{', '.join(map(str, tables))}: {what}")
    rows = np.array([np.mean(looks, axis=0) for looks in fruit.values()])
    return SizeTable(rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4], rows[:, 5:])


def _rows(table: Path, needed: Sequence[str]) -> list[tuple[int, dict[str, str]]]:
    try:
        return read_table(table, needed)
    except NoTableError as error:
        raise UnusableTable(f"{table}: {error}") from error


def _by_hand(table: Path, line: int, row: dict[str, str]) -> list[float] | None:
    """Return width, height, shown [m], deviation of ln shown, sine, and twice 0; None for a fruit without both
    measurements.
    """
    if not (row[TRUE[0]] and row[TRUE[1]] and row["shown_mm"]):
        return None
    width, height, shown, spread, sine = (
        _number(table, line, row, name) for name in (*TRUE, *_SEEN)
    )
    for name, value in zip(TRUE, (width, height), strict=True):
        if not shown / MOST_TIMES <= value <= shown * MOST_TIMES:
            seen = f"the camera saw {shown:.1f} mm"
            raise UnusableTable(
                f"{table}:{line}: {name} is {row[name]}, but {seen}: check its unit (mm) and the fruit"
            )
    return [width / 1e3, height / 1e3, shown / 1e3, spread / _Z_90 / shown, sine, 0.0, 0.0]


def _by_shape(table: Path, line: int, row: dict[str, str]) -> list[float] | None:
    """Return the same with the fit's own errors; None for a fruit without a usable fit of its shape."""
    if not (row.get("method") or "").startswith("shape"):
        return None
    width, width_90, height, height_90 = (_number(table, line, row, name) for name in _BY_SHAPE)
    shown, spread, sine = (_number(table, line, row, name) for name in _SEEN)
    wide, high = width_90 / _Z_90 / width, height_90 / _Z_90 / height
    ratio = float(
        np.hypot(wide, high)
    )  # taken as independent: a common error makes the proportion more certain
    if ratio > LEAST_KNOWN:
        return None
    return [width / 1e3, height / 1e3, shown / 1e3, spread / _Z_90 / shown, sine, wide, ratio]


def _agree(table: Path, line: int, row: dict[str, str], first: Sequence[float]) -> None:
    """A fruit has one size, in whichever of its rows it is written."""
    for name, before in zip(TRUE, first[:2], strict=True):
        # calipers give a fruit's size the same in all of its rows, but for this share
        if abs(float(row[name]) / (1e3 * before) - 1.0) > 0.05:
            other = f"another row of fruit {row[_FRUIT]} has {1e3 * before:g}"
            raise UnusableTable(
                f"{table}:{line}: {name} is {row[name]}, and {other}: a fruit has one size"
            )


def _refuse_exchanged(measured: SizeTable, proportion: float, kind: str) -> None:
    """Width and height were exchanged where that alone makes the fruit like their kind."""
    ratio = float(np.median(measured.sizes[:, 1] / measured.sizes[:, 0]))
    opposite = (ratio - 1.0) * (proportion - 1.0) < 0.0
    if opposite and abs(np.log(ratio / proportion)) > MOST_UNLIKE:
        raise UnusableTable(
            f"height over width of the fruit is {ratio:.2f} (median), of the model of {kind} {proportion:.2f}: "
            f"are {TRUE[0]} and {TRUE[1]} exchanged? If not, this fruit needs another model"
        )


def _number(table: Path, line: int, row: dict[str, str], name: str) -> float:
    try:
        value = float(row[name])
    except (TypeError, ValueError):
        value = float("nan")
    if not (
        np.isfinite(value)
        and (value > 0.0 or (value == 0.0 and name in ("from_side", "shown_90_mm")))
    ):
        raise UnusableTable(f"{table}:{line}: {name} is {row[name]!r}: a number above 0 is needed")
    return value


def _written(learnt: KindSizes, measured: SizeTable) -> str:
    return (
        f"# Learnt from {len(measured.sizes)} fruit; every deviation is a share.\n"
        f"width: {1e3 * learnt.width:.2f} mm\n"
        f"width_deviation: {learnt.width_deviation:.4f}\n"
        f"height_over_width: {learnt.height_over_width:.4f}\n"
        f"height_over_width_deviation: {learnt.height_over_width_deviation:.4f}\n"
        f"looks: {learnt.looks:.4f}\n"
        f"looks_deviation: {learnt.looks_deviation:.4f}\n"
    )


def _mm(errors: Float64) -> str:
    width, height = 1e3 * np.abs(errors).mean(axis=0)
    return f"{width:.1f} / {height:.1f} mm"
