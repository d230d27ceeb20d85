"""Counting, measured: the simulated cell's five apples from several sides, identities and sizes beside the truth.

    python -m benchmarks.bench_count [--seeds 20] [--looks 4] [--method uniform] [--lose-poses] [--json FILE]

Each scene is looked at from places all around the table. Every sighting is given to the true fruit that it shows (its
centre lies in that fruit), which the book does not know: a fruit that the book has twice is split, one that holds two
true fruit is merged. With `--lose-poses` the camera poses are withheld, and its motion is estimated from the frames.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.refine_scenes import CAMERA, DETECTOR_WIDTH, _render
from benchmarks.synthetic_depth import as_d435i, looking_at
from pomona.applications.inventory.book import FruitBook
from pomona.applications.inventory.camera_motion import camera_motion
from pomona.applications.inventory.sighting import Z_90, Sighting, sighting_of
from pomona.drivers.interfaces import Frame
from pomona.executive.cell.connect import load_cell
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse
from pomona.skills.perception.detection.detection import Detection, DetectorOptions
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.perception.refinement.errors import RefineError
from pomona.skills.perception.refinement.measure import measure
from pomona.skills.shared.looking import find_in_frame
from pomona.tools.simulation.gl import in_gl_thread
from pomona.tools.simulation.world import SimWorld

CELL = Path("trees/cells/sim.yaml")
SCORE = 0.6
TABLE = np.array([-0.02, -0.42, -0.08])
"""Point that the camera looks at [m]."""


@dataclass
class CountTally:
    """Results over all scenes."""

    scenes: int = 0
    fruit: int = 0
    found: int = 0
    counted: int = 0
    right: int = 0
    split: int = 0
    merged: int = 0
    none_true: int = 0
    sightings: int = 0
    measured: int = 0
    disagree: int = 0
    joined: int = 0
    pairs: int = 0
    motion_mm: list[float] = field(default_factory=list)
    errors: list[Float64] = field(default_factory=list)
    single: list[Float64] = field(default_factory=list)
    looks: list[list[Float64]] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(description="Counting, measured.")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--looks", type=int, default=4)
    parser.add_argument("--method", choices=("uniform", "shape"), default="uniform")
    parser.add_argument("--lose-poses", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    fruit, tally = load_fruit("apple"), CountTally()
    for seed in range(options.seeds):
        cell = load_cell(CELL, seed=seed, overrides={"others": "4", "distractors": "2"})
        try:
            world = cell.devices["world"]
            assert isinstance(world, SimWorld)
            _scene(world, fruit, options.looks, options.method, options.lose_poses, seed, tally)
        finally:
            cell.close()
    figures = _figures(tally)
    table = Table(
        "what",
        "value",
        title=f"{options.seeds} scenes, {options.looks} looks each, {options.method}",
    )
    for name, value in figures.items():
        table.add_row(name, f"{value:.3g}" if isinstance(value, float) else str(value))
    Console(width=120).print(table)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1))


def _scene(
    world: SimWorld,
    fruit: FruitModel,
    looks: int,
    method: str,
    lose: bool,
    seed: int,
    tally: CountTally,
) -> None:
    rng = np.random.default_rng([seed, 78])
    world.looked()
    truths: Any = world.truth()["fruits"]
    book, shows = FruitBook(), Counter[tuple[int, int]]()
    before: tuple[Frame, Float64] | None = None
    turn, step = rng.uniform(-np.pi, np.pi), 0.12 if lose else 2.0 * np.pi / looks
    for look in range(looks):
        elevation = np.radians(60.0 if lose else rng.uniform(35.0, 80.0))
        T_base_camera = looking_at(TABLE, 0.7, elevation, turn + look * step)
        frame = _expose(world, T_base_camera, rng)
        T_said = np.eye(4) if lose else T_base_camera
        sightings = _sightings(frame, T_said, fruit, method)
        T_scene_base: Float64 | None = np.eye(4)
        deviation = 0.0
        if lose and before is not None:
            motion = camera_motion(before[0], frame)
            tally.pairs += 1
            T_scene_base = None
            if motion.T_earlier_later is not None:
                tally.joined += 1
                T_scene_base, deviation = before[1] @ motion.T_earlier_later, motion.deviation
                at = np.append(
                    inverse(T_base_camera)[:3, :3] @ TABLE + inverse(T_base_camera)[:3, 3], 1.0
                )
                true = inverse(_pose_of(before[0])) @ T_base_camera
                tally.motion_mm.append(
                    1e3 * float(np.linalg.norm(((motion.T_earlier_later - true) @ at)[:3]))
                )
        numbers = book.add_frame(sightings, T_scene_base, deviation)
        before = frame, np.eye(4) if T_scene_base is None else T_scene_base
        for sighting, number in zip(sightings, numbers, strict=True):
            which = _true_fruit(
                sighting.moved(T_base_camera if lose else np.eye(4)), truths, T_base_camera
            )
            shows[number, which] += 1
            tally.sightings += 1
            tally.measured += sighting.dimensions is not None
    _count(book, shows, truths, tally)


def _pose_of(frame: Frame) -> Float64:
    return frame.T_mount_camera


def _expose(world: SimWorld, T_base_camera: Float64, rng: np.random.Generator) -> Frame:
    colour, ideal = in_gl_thread(partial(_render, world, T_base_camera))
    noisy = colour + rng.normal(0.0, 2.0, colour.shape)
    colour = np.clip(cv2.GaussianBlur(noisy, (0, 0), 0.6), 0, 255).astype(np.uint8)
    return Frame(
        0.0, 0, colour, as_d435i(ideal.astype(np.float64), rng, CAMERA), CAMERA, None, T_base_camera
    )


def _sightings(
    frame: Frame, T_base_camera: Float64, fruit: FruitModel, method: str
) -> list[Sighting]:
    found: list[Sighting] = []
    for instance in find_in_frame(frame, fruit, DetectorOptions(working_width=DETECTOR_WIDTH)):
        if (
            instance.score < SCORE
            or instance.T_camera_object is None
            or instance.covariance is None
        ):
            continue
        detection = Detection(
            fruit, frame, T_base_camera, instance.T_camera_object, instance.keypoints, instance.score,
            instance.covariance, len(found), 0, instance.visibility,
        )  # fmt: skip
        measured: MeasuredFruit | None = None
        why = ""
        try:
            measured = measure(detection, method, renderer="zbuffer")
        except RefineError as error:
            why = error.code
        found.append(sighting_of(detection, measured, why, len(found) + 1))
    return found


def _true_fruit(sighting: Sighting, truths: Any, T_base_camera: Float64) -> int:
    """Index of the fruit that a sighting shows: the line of sight passes nearest to its centre, inside it; else -1."""
    eye = T_base_camera[:3, 3]
    ray = (sighting.p_base - eye) / np.linalg.norm(sighting.p_base - eye)
    beside = [
        float(np.linalg.norm(np.cross(ray, np.array(t["T_base_fruit_at_look"])[:3, 3] - eye)))
        for t in truths
    ]
    best = int(np.argmin(beside))
    return best if beside[best] < 0.5 * float(np.min(truths[best]["dimensions_m"])) else -1


def _count(
    book: FruitBook, shows: Counter[tuple[int, int]], truths: Any, tally: CountTally
) -> None:
    tally.scenes += 1
    tally.fruit += len(truths)
    counted = {
        number: {w for n, w in shows if n == number}
        for number in (fruit.number for fruit in book.fruit)
    }
    true = {
        which for which in range(len(truths)) if any(which in some for some in counted.values())
    }
    tally.found += len(true)
    tally.counted += len(book.fruit)
    tally.merged += sum(len(some - {-1}) > 1 for some in counted.values())
    tally.none_true += sum(some == {-1} for some in counted.values())
    times = Counter(which for some in counted.values() for which in some if which >= 0)
    tally.split += sum(count - 1 for count in times.values())
    tally.right += len(book.fruit) == len(true) and all(len(some) == 1 for some in counted.values())
    for fruit in book.fruit:
        (which, *others) = sorted(counted[fruit.number])
        if fruit.size is None or others or which < 0:
            continue
        truth = np.array(truths[which]["dimensions_m"])
        tally.disagree += not fruit.size.agree
        tally.errors.append(_normal(fruit.size.dimensions, fruit.size.covariance, truth))
        looks = [
            _normal(s.dimensions, s.size_covariance, truth)
            for s in fruit.sightings
            if s.dimensions is not None and s.size_covariance is not None
        ]
        tally.single += looks
        tally.looks.append(looks)


def _normal(dimensions: Float64, covariance: Float64, truth: Float64) -> Float64:
    """Errors of mean width and height [mm], and both in standard deviations, (4,)."""
    mean = np.array([[0.5, 0.0, 0.5], [0.0, 1.0, 0.0]])
    error, spread = mean @ (dimensions - truth), np.sqrt(np.diag(mean @ covariance @ mean.T))
    return np.concatenate([1e3 * error, error / spread])


def _figures(t: CountTally) -> dict[str, float | int]:
    fused, single = np.array(t.errors), np.array(t.single)
    products = [a[2:] * b[2:] for looks in t.looks for i, a in enumerate(looks) for b in looks[:i]]
    correlation = np.mean(products, axis=0) / np.mean(single[:, 2:] ** 2, axis=0)
    figures: dict[str, float | int] = {
        "scenes": t.scenes, "true fruit": t.fruit, "of them found": t.found, "counted": t.counted,
        "scenes counted right": t.right, "split": t.split, "merged": t.merged, "no fruit": t.none_true,
        "sightings": t.sightings, "of them measured": t.measured, "fruit whose looks disagree": t.disagree,
        "fruit measured": len(fused),
    }  # fmt: skip
    if t.pairs:
        figures |= {"pairs of frames": t.pairs, "joined": t.joined}
        if t.motion_mm:
            figures |= {
                "motion off, median [mm]": float(np.median(t.motion_mm)),
                "worst [mm]": max(t.motion_mm),
            }
    for k, name in enumerate(("width", "height")):
        figures[f"{name}, one look: mean error [mm]"] = float(np.abs(single[:, k]).mean())
        figures[f"{name}, all looks: mean error [mm]"] = float(np.abs(fused[:, k]).mean())
        figures[f"{name}, all looks: bias [mm]"] = float(fused[:, k].mean())
        figures[f"{name}, one look: in its 90 % interval"] = float(
            (np.abs(single[:, 2 + k]) <= Z_90).mean()
        )
        figures[f"{name}, all looks: in its 90 % interval"] = float(
            (np.abs(fused[:, 2 + k]) <= Z_90).mean()
        )
        figures[f"{name}: correlation of two looks' errors"] = float(correlation[k])
    return figures


if __name__ == "__main__":
    main()
