"""A camera's error, noticed from picks: false alarms, picks until a fault is noticed, and widths of picked fruit.

    python -m benchmarks.bench_caliper [--cells 40] [--picks 25] [--seed 0]

Picks are drawn, not simulated: the model's own noise, the fingers in all azimuths, a camera 0.4 to 0.6 m above the
fruit. Each look shows the table, whose height and tilts in the cell file are off by 1 mm and 0.15° (standard
deviations). After each pick the estimate is made of all picks so far, as `pomona explain` makes it. Good cells have
errors up to 0.5 mm and 0.05°; one fruit in 30 is pushed by 4 to 10 mm where the row has pushed fruit.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import PRIOR, TABLE_HEIGHT, TABLE_TILT, estimate
from pomona.tools.caliper.findings import find_error
from pomona.tools.caliper.pick import Pick
from pomona.tools.caliper.sizes import fused_width
from tests.skills.tools.caliper.synthetic import drawn_error, looked, made_fruit, made_pick

PUSHED = 1.0 / 30.0  # share of pushed fruit
Z_90 = 1.645  # half of a 90 % interval, in standard deviations
WITHIN = 5  # picks within which a fault is to be noticed

Draw = Callable[[np.random.Generator], Float64]


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=40, help="drawn cells in each row")
    parser.add_argument("--picks", type=int, default=25, help="picks in each cell")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print("good cells                     picks   alarms   cells with one")
    for name, how in (
        ("", {}),
        (", pushed fruit", {"pushed": True}),
        (", twice the noise", {"noise": 2.0}),
    ):
        cells = [_alarms(options, k, _good, **how) for k in range(options.cells)]
        begun = sum(int(np.count_nonzero(np.diff([0, *cell]) > 0)) for cell in cells)
        print(
            f"{'as assumed' + name:<30} {sum(map(len, cells)):5} {begun:8} {sum(map(any, cells)):10}"
        )
    print(
        f"faults                         noticed within {WITHIN}   median   90 %   never  [picks]"
    )
    for name, draw in (
        ("5 mm along the picture", _shift),
        ("1° about a line in the picture", _tilt),
        ("1° about the view", _roll),
        ("5 mm along the view", _view),
    ):
        alarms = [_alarms(options, k, draw) for k in range(options.cells)]
        first = np.array([cell.index(True) + 1.0 if any(cell) else np.inf for cell in alarms])
        at = np.sort(first)[[len(first) // 2, int(0.9 * len(first))]]
        share = 100.0 * np.mean(first <= WITHIN)
        print(f"{name:<30} {share:12.0f} % {at[0]:11.0f} {at[1]:6.0f} {np.isinf(first).sum():7}")
    print(
        "cells up to 25 mm, 3°, 3 % off: left (median, 90 %), of it across and along the view; 90 % intervals that hold"
    )
    rows: dict[str, dict[str, Any]] = {
        "30 level picks, no table": {"with_table": False},
        "30 level picks, table": {},
        "60 level picks, table": {"count": 60},
        "30 picks up to 30° tilted, table": {"tilt": np.radians(30.0)},
    }
    for name, how in rows.items():
        left, kept = zip(
            *(_left(options.seed, k, **how) for k in range(options.cells)), strict=True
        )
        at = np.sort(np.array(left), axis=0)[[options.cells // 2, int(0.9 * options.cells)]]
        at *= [1e3, 1e3, 1e3, 180.0 / np.pi, 1e2]
        units = "mm", "mm", "mm", "°", "%"
        words = ", ".join(
            f"{middle:.2f} {most:.2f} {unit}" for middle, most, unit in zip(*at, units, strict=True)
        )
        print(f"{name:<33} {words:>72} {100.0 * np.mean(kept):4.0f} %")
    print("width of picked fruit, median error [mm]: camera alone, fused; 90 % intervals that hold")
    for count in (1, 5, options.picks):
        widths = np.vstack([_widths(options.seed, k, count) for k in range(options.cells)])
        alone, fused = 1e3 * np.median(np.abs(widths[:, :2]), axis=0)
        held = 100.0 * np.mean(np.abs(widths[:, 1]) < Z_90 * widths[:, 2])
        print(f"after {count:2} picks {alone:28.2f} {fused:8.2f} {held:8.0f} %")


def _left(
    seed: int, number: int, *, with_table: bool = True, count: int = 30, tilt: float = 0.0
) -> tuple[Float64, NDArray[np.bool_]]:
    """Return the rest of a cell's error after picks, and which intervals of the seven errors hold, shape (7,).

    The rest: the farthest that a fruit within 0.15 m of the centre lies off, that across and that along the view [m],
    the turn [rad], the depth's scale.

    Args:
        with_table: each look shows the table.
        count: of the picks.
        tilt: largest angle between the fingers' axis and the picture's plane [rad].
    """
    rng = np.random.default_rng([seed, number, 30])
    error = np.array([*[25e-3] * 3, *np.radians([3.0] * 3), 0.03, 1e-3]) * rng.uniform(-1.0, 1.0, 8)
    picks = [made_fruit(rng, error, tilt=tilt, name=f"pick {k}")[0] for k in range(count)]
    wrong = rng.normal(size=3) * [TABLE_HEIGHT, TABLE_TILT, TABLE_TILT]
    found = estimate(looked(picks, error, wrong) if with_table else picks)
    left = error - found.error
    corners = found.centre + np.array(
        [[x, y, 0.0] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)]
    )
    off = np.array([left[:3] + np.cross(left[3:6], p) + left[6] * p for p in corners])
    farthest = [np.linalg.norm(off[:, part], axis=1).max() for part in ([0, 1, 2], [0, 1], [2])]
    held = np.abs(left[:7]) < Z_90 * found.std[:7]
    return np.array([*farthest, np.linalg.norm(left[3:6]), abs(left[6])]), held


def _widths(seed: int, number: int, count: int) -> Float64:
    """Return errors of each fruit's width by the camera and fused, and the deviation, shape (count, 3) [m]."""
    rng = np.random.default_rng([seed, number, count])
    error, bias = drawn_error(rng)
    made = [made_fruit(rng, error, name=f"pick {k}", bias=bias) for k in range(count)]
    found = estimate([pick for pick, _ in made])
    fused = [fused_width(pick, found) for pick, _ in made]
    rows = zip(made, fused, strict=True)
    return np.array(
        [(pick.across - true, width - true, std) for (pick, true), (width, std) in rows]
    )


def _alarms(
    options: argparse.Namespace,
    number: int,
    draw: Draw,
    *,
    pushed: bool = False,
    noise: float = 1.0,
) -> list[bool]:
    """Return whether the camera counts as off after each pick of one cell."""
    rng = np.random.default_rng([options.seed, number])
    error, picks, alarms = draw(rng), list[Pick](), []
    table = np.random.default_rng([options.seed, number, 2]).normal(size=3) * [
        TABLE_HEIGHT,
        TABLE_TILT,
        TABLE_TILT,
    ]
    for k in range(options.picks):
        moved = error.copy()
        if pushed and rng.uniform() < PUSHED:
            moved[:2] += rng.uniform(4e-3, 10e-3) * _unit(rng)
        picks += looked([made_pick(rng, moved, noise=noise, name=f"pick {k}")], error, table)
        alarms.append(find_error(estimate(picks)).is_off)
    return alarms


def _unit(rng: np.random.Generator) -> Float64:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _good(rng: np.random.Generator) -> Float64:
    small = np.array([0.5e-3] * 3 + [float(np.radians(0.05))] * 3)
    return np.concatenate(
        [small * rng.uniform(-1.0, 1.0, 6), PRIOR[6:] * rng.uniform(-1.0, 1.0, 2)]
    )


def _fault(
    rng: np.random.Generator, *, place: Float64 | None = None, angle: Float64 | None = None
) -> Float64:
    error = _good(rng)
    if place is not None:
        error[:3] = place
    if angle is not None:
        error[3:6] = angle
    return error


def _shift(rng: np.random.Generator) -> Float64:
    return _fault(rng, place=5e-3 * np.array([*_unit(rng), 0.0]))


def _view(rng: np.random.Generator) -> Float64:
    return _fault(rng, place=np.array([0.0, 0.0, 5e-3]))


def _tilt(rng: np.random.Generator) -> Float64:
    return _fault(rng, angle=np.radians(1.0) * np.array([*_unit(rng), 0.0]))


def _roll(rng: np.random.Generator) -> Float64:
    return _fault(rng, angle=np.radians([0.0, 0.0, 1.0]))


if __name__ == "__main__":
    main()
