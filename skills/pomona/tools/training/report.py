"""The report of a training run: figures, and pictures of cuboids and heat over held-out frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, UInt8
from pomona.executive.values.pictures import write_picture
from pomona.skills.perception.detection.close_look import FINDER_STRIDE, HEAT
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.instances import find_instances
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.photographs.box_evaluation import box_figures, curve
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.training.evaluation import Evaluation, evaluate, table
from pomona.tools.training.photo_figures import (
    Finds,
    calibration,
    find_boxes,
    judged,
    photo_table,
)
from pomona.tools.training.samples import FrameFolder

_EDGES = (
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 0),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 4),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
)
_PICTURES = 6
FRAMES = 200  # held-out frames that a report measures
LEAST_SCORE = 0.05  # detections with less are left out of the plot of scores


def write_report(
    weights: Path,
    held_out: Path,
    out: Path,
    fruit: str = "apple",
    photographs: PhotoSet | None = None,
) -> Evaluation:
    """Measure weights on held-out frames and write report.md with pictures beside it.

    `held_out` is a folder of annotated frames that were not trained on; `photographs` have boxes and get figures of
    their own.
    """
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
    for k in range(min(_PICTURES, len(folder))):
        name = f"frame_{k}.jpg"
        look = draw(detector, folder.picture(k, halved=False), folder.annotation(k).K, model)
        write_picture(out / name, look)
        lines.append(
            f"![Held-out frame {k}: cuboids on the left, the finder's heat on the right]({name})"
        )
    found = None
    if photographs is not None and photographs.val:
        found = find_boxes(detector, photographs.val)
        lines += ["", *_on_photographs(found, photographs, out)]
    draw_curves(result, found, out / "curves.png")
    lines += [
        "",
        "![Precision over recall, and the share that is right over the score](curves.png)",
    ]
    (out / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return result


def draw_curves(rendered: Evaluation, found: Sequence[Finds] | None, path: Path) -> None:
    """Precision over recall, and the share of finds that are right over their score, of frames and of photographs."""
    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    axes = figure.subplots(1, 2)
    sets = [("rendered frames", rendered.curve(), rendered.judged())]
    if found is not None:
        boxes = [(finds.boxes, finds.scores, finds.labelled) for finds in found]
        sets.append(("photographs, IoU 0.5", curve(boxes), judged(found)))
    axes[1].plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for (name, line, (scores, right)), colour in zip(sets, ("#1c5bc7", "#bd2222"), strict=False):
        axes[0].plot(line.recall, line.precision, color=colour, label=name)
        error, points = calibration(scores[scores >= LEAST_SCORE], right[scores >= LEAST_SCORE])
        said, shares = [point[0] for point in points], [point[1] for point in points]
        axes[1].plot(said, shares, "o-", color=colour, label=f"{name}: error {error:.3f}")
    for part, across, up in (
        (axes[0], "recall", "precision"),
        (axes[1], "score", "share that is right"),
    ):
        part.set(xlabel=across, ylabel=up, xlim=(0, 1), ylim=(0, 1.02))
        part.grid(color="0.9")
        part.legend(loc="lower left" if part is axes[0] else "upper left")
    figure.savefig(path, dpi=110)


def _on_photographs(found: Sequence[Finds], photographs: PhotoSet, out: Path) -> list[str]:
    """Figures, and the photographs with fewest and most errors: detections yellow, boxes of the labels blue."""
    pictures = [finds.judged() for finds in found]
    threshold = box_figures(pictures).threshold
    score = 0.5 if np.isnan(threshold) else threshold
    labelled = sum(picture.labelled for picture in pictures)
    lines = [f"## {len(found)} photographs with {labelled} boxes", "", photo_table(found, 0.5), ""]
    errors = []
    for picture in pictures:
        right, sure = picture.right[0], picture.scores >= score
        errors.append(int((~right & sure).sum()) + picture.labelled - int((right & sure).sum()))
    order = np.argsort(errors, kind="stable")
    crowded = [int(k) for k in order if pictures[int(k)].labelled >= 5]
    for name, chosen in (("best", crowded[:3]), ("worst", [int(k) for k in order[::-1]][:3])):
        for place, k in enumerate(chosen):
            drawn = photographs.val[k].picture()
            finds = found[k]
            for some, colour in (
                (finds.labelled, (0, 160, 255)),
                (finds.boxes[finds.scores >= score], (255, 255, 0)),
            ):
                for x, y, w, h in np.round(some).astype(int).tolist():
                    cv2.rectangle(drawn, (x, y), (x + w, y + h), colour, 2)
            write_picture(out / f"photograph_{name}_{place}.jpg", drawn)
            lines.append(
                f"![One of the {name} photographs, {errors[k]} errors at score ≥ {score:.2f}: detections yellow, boxes "
                f"of the labels blue](photograph_{name}_{place}.jpg)"
            )
    return lines


def draw(
    detector: CompactDetector,
    colour: UInt8,
    K: NDArray[np.float64],
    fruit: FruitModel,
    score: float = 0.5,
) -> UInt8:
    """A frame (h, w, 3) with its cuboids beside the same frame under the finder's heat, (h, 2 w, 3) uint8 RGB."""
    instances = find_instances(detector, colour, K, fruit)
    cuboids = colour.copy()
    for instance in instances:
        if instance.score < score:
            continue
        points = np.round(instance.keypoints).astype(int)
        for a, b in _EDGES:
            top = {a, b} <= {0, 1, 4, 5}
            cv2.line(
                cuboids,
                points[a].tolist(),
                points[b].tolist(),
                (255, 255, 0) if top else (0, 255, 255),
                1,
            )
        cv2.circle(cuboids, points[8].tolist(), 3, (255, 0, 255), -1)
    height, width = colour.shape[:2]
    heat = cv2.resize(heat_map(detector, colour), (width, height))[..., None] * np.array(
        [200.0, 0.0, 0.0]
    )
    return np.hstack([cuboids, np.clip(0.45 * colour + heat, 0, 255).astype(np.uint8)])


def heat_map(detector: CompactDetector, colour: UInt8) -> Float32:
    """Return the finder's heat, 0..1, in cells of the finder's input, (h, w). Raises BadFrame: as of `find`."""
    maps, (width, height) = detector.maps(colour)
    cells = maps[HEAT, : -(-height // FINDER_STRIDE), : -(-width // FINDER_STRIDE)]
    return np.asarray(1.0 / (1.0 + np.exp(-cells)), np.float32)
