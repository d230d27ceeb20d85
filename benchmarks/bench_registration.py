"""Is misplaced depth noticed: frames as they are, and the same with their depth mirrored, turned, moved and widened.

    python -m benchmarks.bench_registration [--seeds 5] [--looks 4] [FOLDER …]

Frames are the simulated cell's table with five apples from all sides, the orchard cell's wall, and those of folders.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.bench_count import CELL, TABLE, _expose
from benchmarks.synthetic_depth import looking_at
from pomona.devices.frames.folder import folder_intrinsics, list_frames
from pomona.drivers.interfaces import Camera, Frame
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.arrays import Float32
from pomona.skills.perception.frame_check import VARIANTS, misplaced_depth
from pomona.tools.simulation.world import SimWorld

ORCHARD = Path("trees/cells/orchard.yaml")
SHIFTS, SCALES = (0.02, 0.03, 0.05, 0.1), (1.1, 1.2, 1.4)
"""Shares of the picture's width by which depth is moved, and how much wider another lens shows it."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Is misplaced depth noticed?")
    parser.add_argument(
        "folders", type=Path, nargs="*", help="recorded frames with intrinsics.yaml"
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--looks", type=int, default=4)
    options = parser.parse_args()
    sources = {
        "table": _table(options.seeds, options.looks),
        "orchard cell": _orchard(options.seeds),
    }
    sources |= {folder.name: _recorded(folder) for folder in options.folders}
    columns: dict[str, dict[str, str]] = {}
    for name, frames in sources.items():
        doubted: dict[str, list[bool]] = {}
        for frame in frames:
            assert frame.depth is not None
            for how, depth in _wrong(frame.depth):
                said = misplaced_depth(replace(frame, depth=np.ascontiguousarray(depth)))
                doubted.setdefault(how, []).append(bool(said))
        columns[name] = {how: f"{sum(some)} of {len(some)}" for how, some in doubted.items()}
    table = Table("depth", *columns, title="frames that are doubted")
    for how in next(iter(columns.values())):
        table.add_row(how, *(column[how] for column in columns.values()))
    Console(width=120).print(table)


def _wrong(depth: Float32) -> Iterator[tuple[str, Float32]]:
    """The depth as it is, then wrong in every way."""
    height, width = depth.shape
    yield "as it is", depth
    for words, turned in VARIANTS.items():
        yield words, depth[turned]
    for share in SHIFTS:
        yield f"moved by {share:.0%} of the width", np.roll(depth, round(share * width), axis=1)
    for scale in SCALES:
        M = np.array(
            [[scale, 0.0, 0.5 * (1 - scale) * width], [0.0, scale, 0.5 * (1 - scale) * height]]
        )
        wider = np.asarray(
            cv2.warpAffine(depth, M, (width, height), flags=cv2.INTER_NEAREST), np.float32
        )
        yield f"shown {scale} times as large", wider


def _table(seeds: int, looks: int) -> Iterator[Frame]:
    for seed in range(seeds):
        cell = load_cell(CELL, seed=seed, overrides={"others": "4", "distractors": "2"})
        try:
            world, rng = cell.devices["world"], np.random.default_rng([seed, 79])
            assert isinstance(world, SimWorld)
            world.looked()
            for _ in range(looks):
                T = looking_at(
                    TABLE, 0.7, np.radians(rng.uniform(35.0, 80.0)), rng.uniform(-np.pi, np.pi)
                )
                yield _expose(world, T, rng)
        finally:
            cell.close()


def _orchard(seeds: int) -> Iterator[Frame]:
    for seed in range(seeds):
        cell = load_cell(ORCHARD, seed=seed)
        try:
            while (frame := cell.device(Camera).latest()) is None:
                cell.clock.advance(0.01)
            yield frame
        finally:
            cell.close()


def _recorded(folder: Path) -> Iterator[Frame]:
    intrinsics = folder_intrinsics(folder)
    assert intrinsics is not None, f"{folder} holds no intrinsics.yaml"
    for recorded in list_frames(folder):
        colour, depth = recorded.read(intrinsics)
        yield Frame(0.0, 0, colour, depth, intrinsics, None, np.eye(4), recorded.label)


if __name__ == "__main__":
    main()
