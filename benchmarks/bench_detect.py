"""Detect against its figures: held-out frames, speed against the full network in the same run, real frames.

python -m benchmarks.bench_detect --frames 1000 [--orchard FOLDER] [--photos FOLDER] [--empty FOLDER]

--orchard holds real frames NAME_color.jpg and fruit.csv (frame, fruit_id, x, y, w, h, ...), --photos photographs with
boxes as `pomona train detect --photos` reads them, of which those to measure on are searched, --empty pictures without
fruit. SHARED_DATA/orchard_apples and SHARED_DATA/orchard_photos are taken when the environment names SHARED_DATA.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import Progress

from benchmarks.photo_border import (
    LEAST_SCORE,
    calibration_error,
    calibration_table,
    recall_at_border,
)
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.detection.instances import Instance, find_instances
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.photographs.box_evaluation import box_figures, box_intervals, match_boxes
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.photographs.photographs import camera_of
from pomona.tools.pytorch.dope_decode import decode_maps
from pomona.tools.pytorch.networks import DopeNetwork, dope_input
from pomona.tools.training.dataset import render_dataset
from pomona.tools.training.evaluation import evaluate, table
from pomona.tools.training.options import WITHOUT_TREES, SceneOptions
from pomona.tools.training.photo_figures import (
    TITLES,
    find_boxes,
    judged,
    photo_table,
)
from pomona.tools.training.samples import FrameFolder

BENCH_SEED = 777_001
"""Neither trained nor validated on."""

ORCHARD_K = np.array([[917.12, 0.0, 957.72], [0.0, 916.97, 550.79], [0.0, 0.0, 1.0]])
ORCHARD_WIDTHS = (960, 1440, 1920)
"""Widths at which 1920 px wide orchard frames are searched."""

EMPTY_WIDTHS = (320, 640)
"""Widths at which pictures without fruit are searched."""

Rows = list[tuple[str, str]]
"""Lines of the summary: figure and value."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=1000, help="held-out frames (1000)")
    parser.add_argument("--fruit", default="apple")
    parser.add_argument("--weights", type=Path, help="other weights than the fruit's own")
    parser.add_argument(
        "--work", type=Path, default=Path("runs/bench_detect"), help="where frames are kept"
    )
    parser.add_argument("--orchard", type=Path, help="folder of real frames")
    parser.add_argument("--photos", type=Path, help="folder of photographs with boxes")
    parser.add_argument("--empty", type=Path, help="folder of pictures without fruit")
    parser.add_argument(
        "--score", type=float, default=0.6, help="score above which errors are counted (0.6)"
    )
    parser.add_argument(
        "--no-speed",
        action="store_true",
        help="leave out the full network, which takes half a minute",
    )
    options = parser.parse_args()
    fruit = load_fruit(options.fruit)
    weights = options.weights or fruit.weights
    if weights is None:
        raise SystemExit(f"there are no weights for {fruit.name}")
    with progress("rendering") as rendered:  # frames that are there already are kept
        plain = SceneOptions(kinds=WITHOUT_TREES)
        render_dataset(
            options.work / fruit.name,
            options.frames,
            BENCH_SEED,
            options.fruit,
            plain,
            progress=rendered,
        )
    with progress("rendering trees") as rendered:
        wild, folder = (
            SceneOptions(kinds=(0.0, 0.0, 0.0, 1.0)),
            options.work / f"{fruit.name}_trees",
        )
        render_dataset(
            folder, max(1, options.frames // 5), BENCH_SEED, options.fruit, wild, progress=rendered
        )
    frames, trees = FrameFolder([options.work / fruit.name]), FrameFolder([folder])
    detector = CompactDetector.load(weights)
    detector.warm_up()
    print(
        f"# Detect, {fruit.name}: {weights.name}, {options.frames} held-out frames of seed {BENCH_SEED}\n"
    )
    with progress("looking") as looked:
        result = evaluate(detector, frames, fruit, options.frames, looked)
    print(table(result, options.score), "\n")
    print(calibration_table(*result.judged()), "\n")
    rows: Rows = []
    recall, precision = result.recall(options.score), result.precision(options.score)
    rows.append(
        (
            f"rendered frames ({result.frames}): recall / precision",
            f"{recall:.3f} / {precision:.3f}",
        )
    )
    rows.append(
        ("rendered frames: recall at precision 0.97", f"{result.curve().recall_at(0.97):.3f}")
    )
    rows.append(
        ("rendered frames: calibration error", f"{calibration_error(*result.judged()):.3f}")
    )
    rows.append(
        ("all of Detect per frame, one thread, median", f"{1e3 * np.median(result.seconds):.1f} ms")
    )
    print(f"## Rendered trees, {len(trees)} frames\n")
    print(table(evaluate(detector, trees, fruit, len(trees)), options.score, brief=True), "\n")
    if not options.no_speed:
        print(speed(detector, frames, fruit), "\n")
    shared = os.environ.get("SHARED_DATA")
    orchard = options.orchard or (Path(shared) / "orchard_apples" if shared else None)
    if orchard is not None and orchard.is_dir():
        print(real_frames(weights, orchard, fruit, options.score, rows), "\n")
    photos = options.photos or (Path(shared) / "orchard_photos" if shared else None)
    if photos is not None and (options.photos or photos.is_dir()):
        print(photographs(detector, photos, fruit, options.score, rows), "\n")
    print(rendered_lookalikes(detector, options, rows), "\n")
    empty = pictures_of(options.empty) if options.empty is not None else []
    for paths, name in (
        (empty, "pictures without fruit"),
        (everyday_pictures(), "everyday pictures"),
    ):
        if paths:
            print(empty_pictures(detector, paths, name, options.score, rows), "\n")
    print(summary(rows, options.score))


def summary(rows: Rows, score: float) -> str:
    """All figures at one threshold, as Markdown, with the processor's name."""
    lines = [
        f"## Summary at score ≥ {score:g}, {processor_name()}",
        "",
        "| figure | value |",
        "|---|---|",
    ]
    return "\n".join([*lines, *(f"| {figure} | {value} |" for figure, value in rows)])


def processor_name() -> str:
    """The processor's name as the system gives it."""
    path = Path("/proc/cpuinfo")
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    named = (
        line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name")
    )
    return next(named, platform.processor() or "unknown processor")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on the error stream, updated with (done, in all)."""
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(what)
        yield lambda done, count: bar.update(task, completed=done, total=count)


def speed(
    detector: CompactDetector, frames: FrameFolder, fruit: FruitModel, rounds: int = 3
) -> str:
    """The whole of Detect against the whole of DOPE at 640 x 480, in turns within this run."""
    full = DopeNetwork().eval()
    pictures = [frames.picture(k, halved=False) for k in range(min(8, len(frames)))]
    K = frames.annotation(0).K
    threads = torch.get_num_threads()
    whole: list[float] = []
    network_only: list[float] = []
    in_one_thread: list[float] = []
    compact: list[float] = []
    for turn in range(rounds):
        for count, took in ((threads, network_only), (1, in_one_thread)):
            torch.set_num_threads(count)
            start = time.perf_counter()
            tensor, _ = dope_input(pictures[turn], downscale_height=480)
            with torch.inference_mode():
                begin = time.perf_counter()
                beliefs, affinities = full(tensor)
                took.append(time.perf_counter() - begin)
            decode_maps(beliefs[-1][0].numpy(), affinities[-1][0].numpy())
            if count == threads:
                whole.append(time.perf_counter() - start)
        torch.set_num_threads(threads)
        for picture in pictures:
            start = time.perf_counter()
            find_instances(detector, picture, K, fruit)
            compact.append(time.perf_counter() - start)
    ratio, ratio_in_one = (
        np.median(network_only) / np.median(compact),
        np.median(in_one_thread) / np.median(compact),
    )
    return "\n".join(
        [
            "## Speed at 640 × 480, medians of this run",
            "",
            f"full network: {1e3 * np.median(network_only):.0f} ms in {threads} threads, "
            f"{1e3 * np.median(in_one_thread):.0f} ms in one",
            f"full network with resize and decoding: {1e3 * np.median(whole):.0f} ms",
            f"compact, all of Detect (resize, networks, decoding, poses), in one: {1e3 * np.median(compact):.1f} ms",
            f"full network / all of compact: {ratio_in_one:.0f} in one thread each, "
            f"{ratio:.0f} in {threads} threads and one",
        ]
    )


def real_frames(weights: Path, folder: Path, fruit: FruitModel, score: float, rows: Rows) -> str:
    """Recall and precision at IoU 0.5 on real orchard frames, at several working widths.

    Precision is a lower bound: only fruit of a few trees is labelled, and finds on others count as wrong. The labelled
    calibration balls are ignored.
    """
    boxes: dict[str, list[tuple[float, float, float, float]]] = {}
    with (folder / "fruit.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if not row["fruit_id"].startswith("BALL"):
                box = float(row["x"]), float(row["y"]), float(row["w"]), float(row["h"])
                boxes.setdefault(row["frame"], []).append(box)
    lines = [
        "## Real orchard frames, IoU 0.5",
        "",
        "| working width | score | labelled | found | right | recall | precision |",
    ]
    lines.append("|---|---|---|---|---|---|---|")
    for width in ORCHARD_WIDTHS:
        detector = CompactDetector.load(
            weights, DetectorOptions(working_width=width, most_fruit=60)
        )
        found = {
            name: find_instances(detector, _read(folder / f"{name}_color.jpg"), ORCHARD_K, fruit)
            for name in sorted(boxes)
        }
        for least in sorted({score, 0.5, 0.7, 0.9}):
            right, count, labelled = 0, 0, sum(map(len, boxes.values()))
            for name, instances in found.items():
                sure = [i for i in instances if i.score >= least]
                drawn = np.array([box_of(i, fruit) for i in sure]).reshape(-1, 4)
                scores = np.array([i.score for i in sure])
                right += int(match_boxes(drawn, scores, np.array(boxes[name]), 0.5).sum())
                count += len(sure)
            shares = f"{right / labelled:.3f} | {right / max(1, count):.3f}"
            lines.append(f"| {width} | {least} | {labelled} | {count} | {right} | {shares} |")
            if least == score:
                rows.append(
                    (
                        f"RGB-D frames, width {width}: labelled apples found",
                        f"{right} of {labelled}",
                    )
                )
    return "\n".join(lines)


def photographs(
    detector: CompactDetector, folder: Path, fruit: FruitModel, score: float, rows: Rows
) -> str:
    """Recall and precision against the boxes of photographs that are measured on, at the scale of training.

    Precision is a lower bound here too: fruit far behind is often without a box.
    """
    try:
        with progress("reading photographs") as read:
            sets = read_photographs(folder, fruit.name, read)
    except BadPhotographs as error:
        raise SystemExit(f"bench_detect: {error}") from error
    if not sets.val:
        return f"## Photographs\n\n{folder.name} has none to measure on"
    # Doubtful detections lengthen the curve, from which average precision is read.
    doubting = detector.looking(replace(detector.options, finder_threshold=LEAST_SCORE))
    with progress("looking") as looked:
        found = find_boxes(doubting, sets.val, looked)
    pictures = [finds.judged() for finds in found]
    figures, bounds = box_figures(pictures), box_intervals(pictures)
    for name in ("recall", "ap50", "ap"):
        low, high = bounds[name]
        value = f"{getattr(figures, name):.3f} ({low:.3f}–{high:.3f})"
        rows.append((f"photographs ({len(found)}): {TITLES[name]}", value))
    scores, right = judged(found)
    sure = scores >= score
    labelled = sum(picture.labelled for picture in pictures)
    value = f"{right[sure].sum() / labelled:.3f} / {right[sure].mean() if sure.any() else 1.0:.3f}"
    rows.append((f"photographs ({len(found)}): recall / precision", value))
    rows.append(
        (
            f"photographs ({len(found)}): calibration error",
            f"{calibration_error(scores, right):.3f}",
        )
    )
    right_at_border, at_border = recall_at_border(found, sets.val, score)
    rows.append(
        (
            f"photographs ({len(found)}): boxes that the border cuts, found",
            f"{right_at_border} of {at_border}",
        )
    )
    boxes = sum(len(photo.boxes) for photo in sets.val)
    places = len({photo.group for photo in sets.val})
    scale = sets.val[0].scale
    title = f"## {len(sets.val)} photographs of {places} places, {boxes} boxes, searched at {scale:.2f} of their width"
    return f"{title}\n\n{photo_table(found, score)}\n\n{calibration_table(*judged(found))}"


def rendered_lookalikes(detector: CompactDetector, options: argparse.Namespace, rows: Rows) -> str:
    """How often something is found in rendered scenes with tomatoes, oranges, balls and cans, and no fruit."""
    folder, count = options.work / f"{options.fruit}_lookalikes", max(1, options.frames // 5)
    scenes = SceneOptions(instances=(0, 0), kinds=(0.6, 0.2, 0.1, 0.1), lookalikes=10)
    with progress("rendering lookalikes") as rendered:
        render_dataset(folder, count, BENCH_SEED, options.fruit, scenes, progress=rendered)
    frames = FrameFolder([folder])
    found = things = 0
    for index in range(count):
        annotation = frames.annotation(index)
        things += len(annotation.decoys)
        finds = detector.find(frames.picture(index, halved=False), annotation.K)
        found += sum(fruit.score >= options.score for fruit in finds)
    rows.append(
        (f"rendered lookalikes ({count} frames): detections per frame", f"{found / count:.3f}")
    )
    return (
        f"## {count} rendered frames of {things} things that are no fruit\n\n"
        f"{found} finds with score ≥ {options.score}, {found / count:.3f} per frame"
    )


EVERYDAY = {
    "skimage": (
        "data",
        ("astronaut", "chelsea", "coffee", "rocket", "motorcycle_left", "motorcycle_right"),
    ),
    "sklearn": ("datasets/images", ("china", "flower")),
}
"""Photographs in colour, without fruit, that come with scikit-image and scikit-learn."""


def everyday_pictures() -> list[Path]:
    """Those of them that are installed here; nothing that is shipped was taught with these."""
    paths = []
    for package, (folder, names) in EVERYDAY.items():
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            inside = Path(spec.origin).parent / folder
            paths += [path for path in sorted(inside.glob("*")) if path.stem in names]
    return paths


def pictures_of(folder: Path) -> list[Path]:
    """All pictures of a folder."""
    paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not paths:
        raise SystemExit(f"bench_detect: {folder} holds no pictures")
    return paths


def empty_pictures(
    detector: CompactDetector, paths: list[Path], name: str, score: float, rows: Rows
) -> str:
    """How often something is found where no fruit is, by working width."""
    lines = [
        f"## {len(paths)} {name}",
        "",
        "| working width | finds at score | per picture | where |",
    ]
    lines.append("|---|---|---|---|")
    for width in EMPTY_WIDTHS:
        searching = detector.looking(replace(detector.options, working_width=width))
        found = {}
        for path in paths:
            picture = _read(path)
            K = camera_of(picture.shape[1], picture.shape[0])
            found[path.stem] = sum(fruit.score >= score for fruit in searching.find(picture, K))
        where = ", ".join(f"{name} {count}" for name, count in found.items() if count)
        total = sum(found.values())
        lines.append(f"| {width} | {total} at {score} | {total / len(paths):.3f} | {where} |")
        rows.append((f"{name} ({len(paths)}), width {width}: detections", str(total)))
    return "\n".join(lines)


def box_of(instance: Instance, fruit: FruitModel) -> tuple[float, float, float, float]:
    """Return the box x, y, w, h of a find [px]: its visible part, or the model's silhouette in its detected pose."""
    if instance.box is not None:
        x, y, w, h = instance.box.tolist()
        return x, y, w, h
    if instance.T_camera_object is None:
        low, high = instance.keypoints.min(axis=0), instance.keypoints.max(axis=0)
    else:
        T = instance.T_camera_object
        points = fruit.vertices @ T[:3, :3].T + T[:3, 3]
        pixels = points[:, :2] / points[:, 2:] * (ORCHARD_K[0, 0], ORCHARD_K[1, 1]) + (
            ORCHARD_K[0, 2],
            ORCHARD_K[1, 2],
        )
        low, high = pixels.min(axis=0), pixels.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _read(path: Path) -> np.ndarray:
    try:
        return read_picture(path, as_taken=True)
    except UnusablePicture as error:
        raise SystemExit(f"{path}: {error}") from error


if __name__ == "__main__":
    main()
