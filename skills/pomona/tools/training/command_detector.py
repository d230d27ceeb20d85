"""`pomona data detect` and `pomona train detect`: the detector's frames and weights."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from pomona.executive.values.installation import need
from pomona.tools.training.progress_bar import ProgressBar

USED_SCORE = 0.5  # of a find that counts: the default of `Detect`


def add_data(subparsers: Any) -> None:
    """Register `pomona data`."""
    parser = subparsers.add_parser("data", help="render training data")
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    detect = kinds.add_parser(
        "detect", help="annotated frames for the detector, in the format DOPE's tools read"
    )
    detect.add_argument(
        "--out", type=Path, required=True, help="folder; frames that are there already are kept"
    )
    detect.add_argument("--frames", type=int, default=1000, help="how many (1000)")
    detect.add_argument("--seed", type=int, default=1, help="seed of the data set (1)")
    detect.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    detect.add_argument("--workers", type=int, help="processes that render (one per core)")
    detect.set_defaults(main=data_main)


def add_train(subparsers: Any) -> None:
    """Register `pomona train`."""
    parser = subparsers.add_parser("train", help="train networks")
    kinds = parser.add_subparsers(metavar="WHAT", required=True)
    detect = kinds.add_parser(
        "detect", help="the detector of a fruit, from rendered frames to a weights file"
    )
    detect.add_argument(
        "--out",
        type=Path,
        default=Path("apple.weights"),
        help="weights file to write (apple.weights)",
    )
    detect.add_argument(
        "--work",
        type=Path,
        default=Path("runs/train_detect"),
        help="frames and checkpoints; resumes (runs/train_detect)",
    )
    detect.add_argument(
        "--quick",
        action="store_true",
        help="minutes instead of hours, starting from existing weights (the apple's)",
    )
    detect.add_argument(
        "--start-from", type=Path, help="weights to start from, in place of the fruit's own"
    )
    detect.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    detect.add_argument("--frames", type=int, help="frames to render in all (the recipe's)")
    detect.add_argument("--steps", type=float, default=1.0, help="factor on the recipe's steps (1)")
    detect.add_argument(
        "--device", default="cpu", choices=("cpu", "cuda"), help="cuda trains in mixed precision"
    )
    detect.add_argument(
        "--workers",
        type=int,
        default=2,
        help="processes that render and prepare batches (2); 0: this process alone",
    )
    detect.set_defaults(main=train_main)


def data_main(options: argparse.Namespace) -> int:
    """Render frames; returns 0, or 2 for a fruit that cannot be rendered."""
    from pomona.skills.perception.fruit.catalogue import FruitError
    from pomona.tools.training.dataset import render_dataset

    try:
        with ProgressBar("frames") as show:
            made = render_dataset(
                options.out,
                options.frames,
                options.seed,
                options.fruit,
                workers=options.workers,
                progress=show,
            )
    except FruitError as error:
        sys.stderr.write(f"pomona data: {error}\n")
        return 2
    Console().print(
        f"{made.rendered} frames rendered, {made.kept} kept from before, in {options.out}"
    )
    return 0


def train_main(options: argparse.Namespace) -> int:
    """Train, write weights and a report beside the checkpoints; returns 0, 1 (they find nothing) or 2 (no start)."""
    for package in ("torch", "onnx"):
        need(package, "torch", "pomona train")
    from pomona.skills.perception.detection.errors import DetectError
    from pomona.skills.perception.fruit.catalogue import FruitError
    from pomona.tools.training import recipe, report

    console = Console()
    try:
        base = recipe.QUICK if options.quick else recipe.SHIPPED
        made = _changed(base, options.frames, options.steps)
        start = _start(options)
        with ProgressBar("frames and places") as show:
            recipe.make_weights(
                options.out,
                options.work,
                options.fruit,
                made,
                options.device,
                options.workers,
                start,
                show,
                lambda name, progress: console.print(_line(name, progress)),
            )
        written = options.work / "report"
        figures = report.write_report(
            options.out, options.work / "held_out", written, options.fruit
        )
    except (DetectError, FruitError) as error:
        sys.stderr.write(f"pomona train: {error}\n")
        return 2
    console.print(f"weights in {options.out}, report in {written}")
    if figures.recall(USED_SCORE) > 0.0:
        return 0
    sys.stderr.write(
        f"pomona train: with the score {USED_SCORE:g} these weights find no fruit in {figures.frames} held-out frames: "
        "train longer, without --quick, or begin with other weights (--start-from)\n"
    )
    return 1


def _changed(recipe: Any, frames: int | None, steps: float) -> Any:
    """Return a recipe with another number of frames in all, and a factor on its steps."""
    share = frames / sum(one.frames for one in recipe.sets) if frames else 1.0
    sets = tuple(
        dataclasses.replace(one, frames=max(1, round(one.frames * share))) for one in recipe.sets
    )
    stages = []
    for stage in recipe.stages:
        schedule = stage.schedule
        schedule = dataclasses.replace(schedule, steps=max(1, round(schedule.steps * steps)))
        stages.append(dataclasses.replace(stage, schedule=schedule))
    return dataclasses.replace(recipe, sets=sets, stages=tuple(stages))


def _start(options: argparse.Namespace) -> Path | None:
    """Return the weights to go on from; None starts from nothing.

    Raises BadWeights: those that were named cannot be learnt on; refused before hours of rendering.
    """
    from pomona.skills.perception.detection.weights_file import read_weights
    from pomona.skills.perception.fruit import load_fruit
    from pomona.tools.pytorch.weights import can_learn, load_compact

    fruit = load_fruit(options.fruit)
    apple = load_fruit("apple")
    if options.start_from is not None:
        load_compact(options.start_from)
        return Path(options.start_from)
    if not options.quick:
        return None
    known = (fruit.photo_weights, fruit.weights, apple.photo_weights)
    return next(path for path in known if path is not None and can_learn(read_weights(path)))


def _line(name: str, progress: Any) -> str:
    held_out = "" if progress.held_out is None else f"  held-out loss {progress.held_out:.4f}"
    return (
        f"{name}  step {progress.step} of {progress.steps}  loss {progress.loss:.4f}  rate {progress.rate:.1e}"
        f"  {progress.seconds:.0f} s{held_out}"
    )
