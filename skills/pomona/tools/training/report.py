"""The report of a training run: figures, and pictures of cuboids and heat over held-out frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.pictures import write_picture
from pomona.skills.perception.detection.close_look import FINDER_STRIDE, HEAT
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import find_instances
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.training.evaluation import Evaluation, evaluate, table
from pomona.tools.training.samples import FrameFolder

FACE = (
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 0),
)  # edges of the cuboid's front; the rear's follow by adding 4
TOP = {0, 1, 4, 5}  # its upper corners
PICTURES = 6
FRAMES = 200  # held-out frames that a report measures


def write_report(weights: Path, held_out: Path, out: Path, fruit: str = "apple") -> Evaluation:
    """Measure weights on a folder of frames that were not trained on; write report.md with pictures beside it."""
    out.mkdir(parents=True, exist_ok=True)
    detector = CompactDetector.load(weights)
    folder = FrameFolder([held_out])
    model = load_fruit(fruit)
    result = evaluate(detector, folder, model, FRAMES)
    lines = [
        f"# Training report: {fruit}",
        "",
        f"Weights `{weights.name}`, {result.frames} held-out frames.",
        "",
        table(result),
        "",
    ]
    for k in range(min(PICTURES, len(folder))):
        name = f"frame_{k}.jpg"
        write_picture(out / name, draw(detector, folder.picture(k), folder.annotation(k).K, model))
        lines.append(
            f"![Held-out frame {k}: cuboids on the left, the finder's heat on the right]({name})"
        )
    (out / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return result


def draw(
    detector: CompactDetector, colour: UInt8, K: Float64, fruit: FruitModel, score: float = 0.5
) -> UInt8:
    """A frame (h, w, 3) with its cuboids beside the same frame under the finder's heat, (h, 2 w, 3) uint8 RGB."""
    cuboids = colour.copy()
    edges = [*FACE, *((a + 4, b + 4) for a, b in FACE), *((a, a + 4) for a in range(4))]
    for instance in find_instances(detector, colour, K, fruit):
        if instance.score < score:
            continue
        points = np.round(instance.keypoints).astype(int).tolist()
        for a, b in edges:
            line = (255, 255, 0) if {a, b} <= TOP else (0, 255, 255)
            cv2.line(cuboids, points[a], points[b], line, 1)
        cv2.circle(cuboids, points[8], 3, (255, 0, 255), -1)
    height, width = colour.shape[:2]
    heat = cv2.resize(heat_map(detector, colour), (width, height))
    under = 0.45 * colour + heat[..., None] * np.array([200.0, 0.0, 0.0])
    return np.hstack([cuboids, np.clip(under, 0, 255).astype(np.uint8)])


def heat_map(detector: CompactDetector, colour: UInt8) -> Float32:
    """Return the finder's heat, 0..1, in cells of the finder's input, (h, w). Raises BadFrame: as of `find`."""
    maps, (width, height) = detector.maps(colour)
    cells = maps[HEAT, : -(-height // FINDER_STRIDE), : -(-width // FINDER_STRIDE)]
    return np.asarray(1.0 / (1.0 + np.exp(-cells)), np.float32)
