"""From nothing to shipped weights: render, train both networks, write one weights file and a report."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.compact_network import (
    CloseLookNetwork,
    FinderNetwork,
    finder_with_boxes,
    with_boxes,
)
from pomona.skills.perception.detection.torch_engine import torch_detector
from pomona.skills.perception.detection.weights import load_compact, save_compact
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.synthetic.dataset import render_dataset
from pomona.skills.perception.synthetic.options import WITHOUT_TREES, SceneOptions
from pomona.skills.perception.training.calibrate import calibrate
from pomona.skills.perception.training.loop import Fall, Progress, Schedule
from pomona.skills.perception.training.photographs import PhotoSet
from pomona.skills.perception.training.places import find_photo_places, find_places, save_places
from pomona.skills.perception.training.samples import FrameFolder
from pomona.skills.perception.training.train import Part, TrainingRun, train_part

LEAST_SHARE = 8
"""A process that learns has at least this part of a batch: statistics of fewer pictures say little."""


@dataclass(frozen=True, slots=True)
class TrainingStage:
    """One stretch of training; a later stage of a network starts from the averaged weights of the one before.

    Attributes:
        part: which network.
        steps, rate, batch, fall: as in `Schedule` and `TrainingRun`.
        turned: share of the close looks that are turned by any angle about their axis.
        sets: how many of the recipe's sets of frames are learnt from, from the first on.
        photos: share of each batch that comes from photographs.
        average: decay of the running average of weights, as in `Schedule`.
        warm_up: steps in which the rate rises, as in `Schedule`.
    """

    part: Part
    steps: int
    rate: float
    batch: int
    turned: float = 0.0
    fall: Fall = "cosine"
    sets: int = 1
    photos: float = 0.0
    average: float = 0.998
    warm_up: int = 60


@dataclass(frozen=True, slots=True)
class FrameSet:
    """Rendered frames: how many, of which seed, and what is in them, as in `SceneOptions`."""

    frames: int
    seed: int
    kinds: tuple[float, float, float, float] = SceneOptions().kinds
    instances: tuple[int, int] = SceneOptions().instances
    lookalikes: int = 0


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a fruit's weights are made.

    Attributes:
        sets: frames to learn from.
        held_out: frames to validate on.
        stages: in order.
    """

    sets: tuple[FrameSet, ...]
    held_out: FrameSet
    stages: tuple[TrainingStage, ...]


SHIPPED = Recipe(
    # What is trained on and what is only measured on never share a seed.
    sets=(FrameSet(16_000, 1, WITHOUT_TREES), FrameSet(8_000, 2, (0.25, 0.25, 0.0, 0.5))),
    held_out=FrameSet(400, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", 1600, 3e-3, 16),
        # Upright looks alone teach where stems mostly are, not what they look like; too many turned ones turn over
        # fruit that stands (docs/decisions/detect-network.md).
        TrainingStage("close_look", 6200, 3e-3, 192, turned=0.2, fall="late"),
        # The same once more, with trees among the frames and more heaps, where most was still wrong.
        TrainingStage("finder", 1500, 3e-3, 16, sets=2),
        TrainingStage("close_look", 5900, 3e-3, 192, turned=0.2, fall="late", sets=2),
    ),
)
"""What `make train-detect` carries out; how the weights in the repository came about is in docs/model_cards."""

WITH_PHOTOGRAPHS = Recipe(
    sets=(
        FrameSet(1300, 1, (0.4, 0.25, 0.1, 0.0)),
        FrameSet(700, 2, (0.25, 0.25, 0.0, 0.5)),
        FrameSet(500, 3, (0.5, 0.25, 0.1, 0.15), (0, 2), 10),
    ),
    held_out=FrameSet(60, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", 2400, 2e-3, 24, fall="late", sets=3, photos=0.6),
        TrainingStage("close_look", 2000, 2e-3, 96, turned=0.2, fall="late", sets=3, photos=0.5),
    ),
)
"""What `pomona train detect --photos` carries out, from weights that rendered frames gave."""

QUICK = Recipe(
    sets=(FrameSet(160, 1, WITHOUT_TREES),),
    held_out=FrameSet(16, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", 80, 1e-3, 8, fall="late", average=0.95, warm_up=10),
        TrainingStage("close_look", 120, 1e-3, 48, turned=0.1, fall="late", average=0.95, warm_up=10),
    ),
)
"""What `pomona train detect --quick` carries out, from another fruit's weights: minutes, to see a first pick."""

WARM_UP, VALIDATE_EVERY, SAVE_EVERY = 50, 100, 25
"""Where photographs are learnt from, steps are few and dear."""

MOST_SEARCHED = 400
"""There so many frames, and so many photographs, are searched for what deceives the finder."""

CALIBRATED_ON = 120
"""The scores' map is fitted on so many held-out frames, and on so many photographs that were learnt from."""

Say = Callable[[str, Progress], None]


def make_weights(
    out: Path,
    work: Path,
    fruit: str = "apple",
    recipe: Recipe = SHIPPED,
    device: str = "cpu",
    workers: int = 2,
    data: Path | None = None,
    rendered: Callable[[int, int], None] | None = None,
    say: Say | None = None,
    photographs: PhotoSet | None = None,
    start: Path | None = None,
) -> Path:
    """Carry out a recipe; what an earlier call left in `work` is kept and gone on with.

    Args:
        out: the weights file.
        work: folder for frames and checkpoints.
        fruit: name in the catalogue.
        recipe: what to do.
        device: "cpu" or "cuda".
        workers: processes that render, and prepare batches or, on a CPU, learn; 0 prepares them in the one that learns.
        data: folder of frames made before, for all stages; None renders the recipe's into `work`.
        rendered: called with (frames done, frames in all).
        say: called with the stage's name and its progress.
        photographs: with boxes, for the stages that learn from them.
        start: weights to go on from; None starts from nothing.

    Returns:
        `out`.

    Raises:
        BadTraining: what `work` holds belongs to another training.
        BadWeights: `start` cannot be read or does not fit.
    """
    held_out = work / "held_out"
    folders = (data,) if data else tuple(work / f"frames_{k}" for k in range(len(recipe.sets)))
    render_set(held_out, recipe.held_out, fruit, workers)
    if data is None:
        for folder, frames in zip(folders, recipe.sets, strict=True):
            render_set(folder, frames, fruit, workers, rendered)
    making = _Making(work, held_out, folders, device, workers, rendered, photographs, start)
    for number, stage in enumerate(recipe.stages):
        name = f"{stage.part} {number + 1}/{len(recipe.stages)}"
        making.teach(number, stage, None if say is None else lambda p, name=name: say(name, p))  # type: ignore[misc]
    detector = making.detector()
    about = {"fruit": fruit, "recipe": repr(recipe), "torch": str(torch.__version__), **_source(photographs, start)}
    some = () if photographs is None else photographs.train[:: _every(len(photographs.train), CALIBRATED_ON)]
    scores = calibrate(detector, FrameFolder([held_out]), load_fruit(fruit), CALIBRATED_ON, some)
    save_compact(out, making.networks["finder"], making.networks["close_look"], about, scores)
    return out


class _Making:
    """The networks on their way through a recipe's stages, and the stage that last taught each of them."""

    def __init__(
        self,
        work: Path,
        held_out: Path,
        folders: tuple[Path, ...],
        device: str,
        workers: int,
        rendered: Callable[[int, int], None] | None,
        photographs: PhotoSet | None,
        start: Path | None,
    ) -> None:
        self.networks: dict[str, Any] = {"finder": FinderNetwork(), "close_look": CloseLookNetwork()}
        self._made_by: dict[str, int] = {}
        if start is not None:
            finder, close_look, _ = load_compact(start)
            self.networks = {"finder": finder_with_boxes(finder), "close_look": with_boxes(close_look)}
            self._made_by = dict.fromkeys(self.networks, -1)
        self._work, self._held_out, self._folders = work, held_out, folders
        self._device, self._workers = device, workers
        self._rendered, self._photographs = rendered, photographs

    def detector(self) -> CompactDetector:
        """What the networks find as they are now."""
        self.networks = {name: network.cpu().eval() for name, network in self.networks.items()}
        return torch_detector(self.networks["finder"], self.networks["close_look"])

    def teach(self, number: int, stage: TrainingStage, say: Callable[[Progress], None] | None) -> None:
        """One stage of the recipe."""
        learnt_from, close = self._folders[: stage.sets], stage.part == "close_look"
        run = TrainingRun(
            stage.part,
            learnt_from,
            self._held_out,
            self._work / f"stage_{number}",
            stage.batch,
            _schedule(stage),
            seed=number,
            places=self._places(stage, learnt_from) if close else None,
            start_from=self.networks[stage.part].state_dict() if stage.part in self._made_by else None,
            device=self._device,
            # A GPU waits for its batches; on a CPU the network itself needs the cores.
            workers=self._workers if self._device == "cuda" else min(1, self._workers),
            processes=1 if self._device == "cuda" else max(1, min(self._workers, stage.batch // LEAST_SHARE)),
            turned=stage.turned,
            photographs=self._photographs if stage.photos else None,
            photo_share=stage.photos,
            photo_places=self._photo_places() if close and stage.photos else None,
            finder=self.networks["finder"] if close else None,
        )
        self.networks[stage.part] = train_part(run, say)
        self._made_by[stage.part] = number

    def _places(self, stage: TrainingStage, learnt_from: tuple[Path, ...]) -> Path:
        """Where the finder sends the close look in rendered frames; found once."""
        file = self._work / f"places_{self._made_by['finder']}_{len(learnt_from)}.npz"
        if not file.is_file():
            most = MOST_SEARCHED if stage.photos else None
            save_places(file, find_places(self._searching(), FrameFolder(list(learnt_from)), self._rendered, most))
        return file

    def _photo_places(self) -> Path | None:
        """The same in photographs."""
        if self._photographs is None:
            return None
        file = self._work / f"places_{self._made_by['finder']}_photographs.npz"
        if not file.is_file():
            found = find_photo_places(self._searching(), self._photographs, self._rendered, MOST_SEARCHED)
            save_places(file, found)
        return file

    def _searching(self) -> CompactDetector:
        return torch_detector(self.networks["finder"].cpu(), self.networks["close_look"])


def _source(photographs: PhotoSet | None, start: Path | None) -> dict[str, str]:
    """What weights were learnt from besides rendered frames, for their file."""
    about = {}
    if photographs is not None:
        boxes = sum(len(photograph.boxes) for photograph in photographs.train)
        about["photographs"] = f"{len(photographs.train)} with {boxes} boxes"
        if photographs.empty:
            about["pictures without fruit"] = str(len(photographs.empty))
    if start is not None:
        about["went on from"] = hashlib.sha256(start.read_bytes()).hexdigest()
    return about


def _every(count: int, most: int) -> int:
    return max(1, -(-count // most))


def _schedule(stage: TrainingStage) -> Schedule:
    schedule = Schedule(stage.steps, stage.rate, stage.fall, stage.warm_up, average=stage.average)
    if not stage.photos:
        return schedule
    return replace(schedule, warm_up=WARM_UP, validate_every=VALIDATE_EVERY, save_every=SAVE_EVERY)


def render_set(
    folder: Path, frames: FrameSet, fruit: str, workers: int, rendered: Callable[[int, int], None] | None = None
) -> None:
    """Render a set of frames into a folder; those that are there already are kept."""
    options = SceneOptions(kinds=frames.kinds, instances=frames.instances, lookalikes=frames.lookalikes)
    render_dataset(folder, frames.frames, frames.seed, fruit, options, workers=workers, progress=rendered)
