"""`pomona learn`: labels proposed from recorded runs, and weights learnt on from them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.recording.folder import find_record
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import NodeChanged, Published, RunStarted
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import need
from pomona.executive.views import ImageView
from pomona.tools.training.proposals import RecordedLook

PICKED_BY = "Lift"  # skill whose success means that the chosen fruit is in the hand

RECORDS = Path("runs")


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "learn",
        help="train a detector further on recorded runs; the result is kept only if no figure is worse",
    )
    parser.add_argument("runs", nargs="+", metavar="RUN", help="names or folders of records")
    parser.add_argument(
        "--out", type=Path, default=Path("learnt.weights"), help="new weights file (learnt.weights)"
    )
    parser.add_argument(
        "--work", type=Path, default=Path("runs/learn"), help="proposals, frames and checkpoints"
    )
    parser.add_argument("--record", type=Path, default=RECORDS, help="folder of the records (runs)")
    parser.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    parser.add_argument(
        "--start-from", type=Path, help="weights to start from (the fruit's photo_weights)"
    )
    parser.add_argument(
        "--propose",
        action="store_true",
        help="only write the proposals, so that you can correct them",
    )
    parser.add_argument(
        "--workers", type=int, default=1, help="processes for rendering and training (1)"
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Propose, learn and compare.

    Returns:
        0; 1 where the new weights are worse and not kept; 2 where the input cannot be used.
    """
    for package in ("torch", "onnx"):
        need(package, "torch", "pomona learn")
    from pomona.skills.perception.detection.compact_detector import CompactDetector
    from pomona.skills.perception.detection.errors import BadTraining, DetectError
    from pomona.skills.perception.fruit import load_fruit
    from pomona.skills.perception.fruit.catalogue import FruitError
    from pomona.tools.photographs.photo_folder import read_photographs
    from pomona.tools.training.learning import check_start, learn
    from pomona.tools.training.proposals import write_proposals

    proposals = options.work / "proposals"
    try:
        fruit = load_fruit(options.fruit)
        start = options.start_from or fruit.photo_weights or fruit.weights
        if start is None:
            raise BadTraining(
                f"{fruit.name} has no weights to start from: name some with --start-from"
            )
        check_start(start)
        if options.out.exists():
            raise BadTraining(f"{options.out} is there already: name another file with --out")
        if not proposals.is_dir():  # proposals that a person corrected are kept
            looks = [
                look
                for name in options.runs
                for look in recorded_looks(find_record(name, options.record))
            ]
            if not looks:
                raise BadTraining("no run has a frame with depth in which Detect searched")
            part = proposals.with_suffix(".part")
            labels, doubtful = write_proposals(part, looks, CompactDetector.load(start), fruit)
            part.rename(proposals)
            sys.stdout.write(
                f"{labels} labels and {doubtful} doubtful boxes in {len(looks)} frames: {proposals}\n"
            )
        if options.propose:
            return 0
        photographs = read_photographs(proposals, fruit.name)
        learnt = learn(
            options.out, options.work, photographs, start, options.fruit, workers=options.workers
        )
    except (DetectError, FruitError, OSError) as error:
        sys.stderr.write(f"pomona learn: {error}\n")
        return 2
    sys.stdout.write(f"before: {learnt.before.text()}\nafter:  {learnt.after.text()}\n")
    kept = f"written to {options.out}" if learnt.is_kept else "not kept: a figure is worse"
    sys.stdout.write(f"new weights {kept}\n")
    return 0 if learnt.is_kept else 1


def recorded_looks(record: Path) -> Sequence[RecordedLook]:
    """Return the frames with depth in which a run's Detect searched, with the places of fruit that it then picked.

    Raises UsageError: the record cannot be read.
    """
    looks: list[RecordedLook] = []
    lifts: set[str] = set()
    chosen: Float64 | None = None
    for event in read_events(record):
        if isinstance(event, RunStarted):
            lifts = {node["path"] for node in event.nodes if node.get("type") == PICKED_BY}
        elif isinstance(event, NodeChanged) and event.path in lifts and event.status == "SUCCESS":
            if looks and chosen is not None:
                looks[-1] = replace(looks[-1], picked=np.vstack([looks[-1].picked, chosen]))
                chosen = None
        elif (
            isinstance(event, Published)
            and event.topic == "detection"
            and isinstance(event.value, ImageView)
        ):
            view = event.value
            if view.image is None or view.depth is None or view.pinhole is None:
                continue
            p = view.pinhole
            K = np.array([[p.fx, 0.0, p.cx], [0.0, p.fy, p.cy], [0.0, 0.0, 1.0]])
            found = [line.points for line in view.lines if line.style == "found"]
            chosen = np.nanmean(found[0], axis=0)[None] if found else None
            looks.append(RecordedLook(record.name, view.image, view.depth, K))
    return looks
