"""From nothing to shipped weights: render, train both networks, write one weights file and a report."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import torch

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.weights_file import read_weights
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact
from pomona.tools.training.dataset import render_dataset
from pomona.tools.training.eight_bits import round_weights
from pomona.tools.training.loop import Progress, Schedule
from pomona.tools.training.options import WITHOUT_TREES, SceneOptions
from pomona.tools.training.places import find_places, save_places
from pomona.tools.training.samples import FrameFolder
from pomona.tools.training.torch_engine import torch_detector
from pomona.tools.training.train import Part, TrainingRun, train_part


@dataclass(frozen=True, slots=True)
class TrainingStage:
    """One stretch of training; a later stage of a network starts from the averaged weights of the one before."""

    part: Part  # which network
    schedule: Schedule  # length and rates
    batch: tuple[int, ...]  # samples of a batch from each of the recipe's sets, from the first on
    turned: float = 0.0  # ratio of the close looks that are turned by any angle about their axis


@dataclass(frozen=True, slots=True)
class FrameSet:
    """Rendered frames: how many, of which seed, and how often each kind of scene appears."""

    frames: int
    seed: int
    kinds: tuple[float, float, float, float] = SceneOptions().kinds


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a fruit's weights are made."""

    sets: tuple[FrameSet, ...]  # frames to learn from
    held_out: FrameSet  # frames to validate on
    stages: tuple[TrainingStage, ...]  # in order


SHIPPED = Recipe(
    # Sets that are trained on and sets that are only measured on never share a seed.
    sets=(FrameSet(16_000, 1, WITHOUT_TREES), FrameSet(8_000, 2, (0.25, 0.25, 0.0, 0.5))),
    held_out=FrameSet(400, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", Schedule(1600, 3e-3), (16,)),
        # Upright looks alone teach where stems mostly are, not their appearance; too many turned ones turn over
        # fruit that stands: 2 % with a fifth turned, 25 % with two fifths.
        TrainingStage("close_look", Schedule(6200, 3e-3, "late"), (192,), turned=0.2),
        # The same once more, with trees among the frames and more heaps, where most was still wrong.
        TrainingStage("finder", Schedule(1500, 3e-3), (11, 5)),
        TrainingStage("close_look", Schedule(5900, 3e-3, "late"), (128, 64), turned=0.2),
    ),
)
"""The recipe of `make train-detect`; docs/model_cards describes the making of the shipped weights."""

QUICK = Recipe(
    sets=(FrameSet(160, 1, WITHOUT_TREES),),
    held_out=FrameSet(16, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", Schedule(80, 1e-3, "late", warm_up=10, average=0.95), (8,)),
        TrainingStage(
            "close_look", Schedule(120, 1e-3, "late", warm_up=10, average=0.95), (48,), turned=0.1
        ),
    ),
)
"""Recipe of `pomona train detect --quick`, from another fruit's weights: minutes, for a first pick."""

SHOWN = 30  # rendered frames that show the ranges of values for rounding


def make_weights(
    out: Path,
    work: Path,
    fruit: str = "apple",
    recipe: Recipe = SHIPPED,
    device: str = "cpu",
    workers: int = 2,
    start: Path | None = None,
    rendered: Callable[[int, int], None] | None = None,
    say: Callable[[str, Progress], None] | None = None,
) -> None:
    """Carry out a recipe; the content of `work` from an earlier call is kept and continued.

    Args:
        out: the weights file.
        work: folder for frames and checkpoints.
        fruit: name in the catalogue.
        recipe: its sets and stages.
        device: "cpu" or "cuda".
        workers: processes that render and prepare batches; 0 prepares them in this one.
        start: weights to go on from, whose score is kept; None starts from nothing.
        rendered: called with (frames done, frames in all).
        say: called with the stage's name and its progress.

    Raises:
        BadTraining: the content of `work` belongs to another training.
        BadWeights: `start` cannot be read or does not fit.
    """
    held_out = work / "held_out"
    render_set(held_out, recipe.held_out, fruit, workers)
    folders = [work / f"frames_{k}" for k in range(len(recipe.sets))]
    for folder, frames in zip(folders, recipe.sets, strict=True):
        render_set(folder, frames, fruit, workers, rendered)
    finder, close_look = _first_networks(start)
    for number, stage in enumerate(recipe.stages):
        name = f"{stage.part} {number + 1}/{len(recipe.stages)}"
        learnt_from = tuple(zip(folders, stage.batch, strict=False))
        places = None
        if stage.part == "close_look":
            places = work / f"places_{number}.npz"
            if not places.is_file():
                frames_there = FrameFolder([folder for folder, _ in learnt_from])
                detector = torch_detector(finder, close_look)
                save_places(places, find_places(detector, frames_there, rendered))
        run = TrainingRun(
            stage.part,
            learnt_from,
            work / f"stage_{number}",
            stage.schedule,
            held_out=held_out,
            seed=number,
            places=places,
            device=device,
            # A GPU waits for its batches; on a CPU the network itself needs the cores.
            workers=workers if device == "cuda" else min(1, workers),
            turned=stage.turned,
        )
        report = None if say is None else lambda progress, name=name: say(name, progress)
        if stage.part == "finder":
            finder = train_part(run, finder, report)
        else:
            close_look = train_part(run, close_look, report)
    about = {"fruit": fruit, "recipe": repr(recipe), "torch": str(torch.__version__)}
    scores = None
    if start is not None:
        about["went on from"] = hashlib.sha256(start.read_bytes()).hexdigest()
        scores = read_weights(start).scores
    save_compact(out, finder.cpu(), close_look.cpu(), about, scores)
    round_weights(out, _shown(FrameFolder([held_out])))


def _first_networks(start: Path | None) -> tuple[FinderNetwork, CloseLookNetwork]:
    if start is not None:
        finder, close_look = load_compact(start)
        finder.keep_trunk()
        return finder, close_look
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)  # a run that is started again begins with the same weights
        return FinderNetwork(), CloseLookNetwork()


def _shown(frames: FrameFolder) -> Iterator[tuple[UInt8, Float64]]:
    """Pictures and camera matrices that show the ranges of the networks' values."""
    for index in range(min(SHOWN, len(frames))):
        yield frames.picture(index), frames.annotation(index).K


def render_set(
    folder: Path,
    frames: FrameSet,
    fruit: str,
    workers: int,
    rendered: Callable[[int, int], None] | None = None,
) -> None:
    """Render a set of frames into a folder; those that are there already are kept."""
    options = SceneOptions(kinds=frames.kinds)
    render_dataset(
        folder, frames.frames, frames.seed, fruit, options, workers=workers, progress=rendered
    )
