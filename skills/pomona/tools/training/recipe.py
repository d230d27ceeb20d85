"""From nothing to shipped weights: render, train both networks, write one weights file and a report."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.weights_file import FusedScore
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.pytorch.networks import FROZEN, CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact
from pomona.tools.training.dataset import render_dataset
from pomona.tools.training.eight_bits import round_weights
from pomona.tools.training.finder_samples import OVER_SCALES, PHOTO_JITTER
from pomona.tools.training.fit_score import fit_score, frame_places, photo_places
from pomona.tools.training.loop import Fall, Progress, Schedule
from pomona.tools.training.optimiser import Method
from pomona.tools.training.options import WITHOUT_TREES, SceneOptions
from pomona.tools.training.places import find_places, save_places
from pomona.tools.training.samples import FrameFolder
from pomona.tools.training.torch_engine import torch_detector
from pomona.tools.training.train import Part, TrainingRun, train_part
from pomona.tools.training.trunk import load_trunk

LEAST_SHARE = (
    8  # least part of a batch in a process that learns: batch norms need this many pictures
)


@dataclass(frozen=True, slots=True)
class TrainingStage:
    """One stretch of training; a later stage of a network starts from the averaged weights of the one before.

    Attributes:
        part: which network.
        steps, rate, fall: as in `Schedule`.
        batch: samples of a batch from each of the recipe's sets of frames, from the first on.
        turned: ratio of the close looks that are turned by any angle about their axis.
        photos, empty: windows of a batch from photographs, and from pictures without fruit.
        average: decay of the running average of weights, as in `Schedule`.
        warm_up: steps in which the rate rises, as in `Schedule`.
        method, decay, clip: as in `Schedule`.
        kept, jitter: as in `TrainingRun`.
    """

    part: Part
    steps: int
    rate: float
    batch: tuple[int, ...]
    turned: float = 0.0
    fall: Fall = "cosine"
    photos: int = 0
    empty: int = 0
    average: float = 0.998
    warm_up: int = 60
    method: Method = "muon"
    decay: float = 0.05
    clip: float = 5.0
    kept: int = FROZEN
    jitter: float = PHOTO_JITTER


@dataclass(frozen=True, slots=True)
class FrameSet:
    """Rendered frames: how many, of which seed, and their content, as in `SceneOptions`."""

    frames: int
    seed: int
    kinds: tuple[float, float, float, float] = SceneOptions().kinds
    instances: tuple[int, int] = SceneOptions().instances
    lookalikes: int = 0
    distractors: int = SceneOptions().distractors


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a fruit's weights are made."""

    sets: tuple[FrameSet, ...]  # frames to learn from
    held_out: FrameSet  # frames to validate on
    stages: tuple[TrainingStage, ...]  # in order
    # frames on which the score is fitted, beside one in `FITTED` of the photographs that were learnt from
    fit: tuple[FrameSet, ...]


FIT = (
    FrameSet(80, 53, (0.3, 0.2, 0.1, 0.4)),
    FrameSet(40, 54, (0.5, 0.25, 0.1, 0.15), (0, 2), lookalikes=10),
    FrameSet(100, 58, WITHOUT_TREES),
)
"""Frames on which scores are fitted: some hold lookalikes, without which lookalikes pass as fruit."""

SHIPPED = Recipe(
    # Sets that are trained on and sets that are only measured on never share a seed.
    sets=(FrameSet(16_000, 1, WITHOUT_TREES), FrameSet(8_000, 2, (0.25, 0.25, 0.0, 0.5))),
    held_out=FrameSet(400, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", 1600, 3e-3, (16,)),
        # Upright looks alone teach where stems mostly are, not their appearance; too many turned ones turn over
        # fruit that stands: 2 % with a fifth turned, 25 % with two fifths.
        TrainingStage("close_look", 6200, 3e-3, (192,), turned=0.2, fall="late"),
        # The same once more, with trees among the frames and more heaps, where most was still wrong.
        TrainingStage("finder", 1500, 3e-3, (11, 5)),
        TrainingStage("close_look", 5900, 3e-3, (128, 64), turned=0.2, fall="late"),
    ),
    fit=FIT,
)
"""The recipe of `make train-detect`; docs/model_cards describes the making of the shipped weights."""

WITH_PHOTOGRAPHS = Recipe(
    sets=(
        FrameSet(1060, 31, (0.3, 0.2, 0.1, 0.4)),
        FrameSet(260, 52, (0.5, 0.25, 0.1, 0.15), (0, 2), lookalikes=10),
        FrameSet(240, 55, (0.4, 0.25, 0.1, 0.25), (1, 5), distractors=14),
    ),
    held_out=FrameSet(60, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage(
            "finder",
            1400,
            1.8e-3,
            (2, 2, 1),
            fall="late",
            photos=9,
            empty=2,
            average=0.997,
            warm_up=50,
            method="adam",
            decay=0.02,
            clip=10.0,
        ),
    ),
    fit=FIT,
)
"""The recipe of `pomona train detect --photos`: the finder learns, the close look keeps its weights."""

WITH_MANY_SCALES = Recipe(
    sets=(
        FrameSet(240, 71, (0.3, 0.2, 0.1, 0.4)),
        FrameSet(120, 72, (0.5, 0.25, 0.1, 0.15), (0, 2), lookalikes=10),
    ),
    held_out=FrameSet(60, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage(
            "finder",
            600,
            8e-4,
            (1, 1),
            fall="late",
            photos=11,
            empty=3,
            average=0.99,
            warm_up=30,
            method="adam",
            decay=0.02,
            clip=10.0,
            kept=8,
            jitter=OVER_SCALES,
        ),
    ),
    fit=FIT,
)
"""The recipe of `--scales`: a finder of photographs learns on over all sizes at which `pomona detect` searches."""

QUICK = Recipe(
    sets=(FrameSet(160, 1, WITHOUT_TREES),),
    held_out=FrameSet(16, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage("finder", 80, 1e-3, (8,), fall="late", average=0.95, warm_up=10),
        TrainingStage(
            "close_look", 120, 1e-3, (48,), turned=0.1, fall="late", average=0.95, warm_up=10
        ),
    ),
    fit=(FrameSet(24, 53, WITHOUT_TREES),),
)
"""Recipe of `pomona train detect --quick`, from another fruit's weights: minutes, for a first pick."""

VALIDATE_EVERY, SAVE_EVERY = 100, 25
"""Steps between validations and checkpoints where photographs are learnt from: steps there are few and slow."""

SHOWN = 30  # rendered frames, and photographs about as many, that show the ranges of values for rounding

FITTED = 6  # interval of the training photographs on which the score is fitted

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
    trunk: Path | None = None,
) -> Path:
    """Carry out a recipe; the content of `work` from an earlier call is kept and continued.

    Args:
        out: the weights file.
        work: folder for frames and checkpoints.
        fruit: name in the catalogue.
        recipe: its sets and stages.
        device: "cpu" or "cuda".
        workers: processes that render, and prepare batches or, on a CPU, learn; 0 prepares them in the one that learns.
        data: folder of frames made before, for all stages; None renders the recipe's into `work`.
        rendered: called with (frames done, frames in all).
        say: called with the stage's name and its progress.
        photographs: with boxes, for the stages that learn from them.
        start: weights to go on from; None starts from nothing.
        trunk: published weights of EfficientNet-Lite0 for the finder's trunk, see `load_trunk`.

    Returns:
        `out`.

    Raises:
        BadTraining: the content of `work` belongs to another training.
        BadWeights: `start` cannot be read or does not fit.
    """
    held_out = work / "held_out"
    folders = (data,) if data else tuple(work / f"frames_{k}" for k in range(len(recipe.sets)))
    render_set(held_out, recipe.held_out, fruit, workers)
    if data is None:
        for folder, frames in zip(folders, recipe.sets, strict=True):
            render_set(folder, frames, fruit, workers, rendered)
    making = _Making(work, held_out, folders, device, workers, rendered, photographs, start, trunk)
    for number, stage in enumerate(recipe.stages):
        name = f"{stage.part} {number + 1}/{len(recipe.stages)}"
        making.teach(number, stage, None if say is None else lambda p, name=name: say(name, p))  # type: ignore[misc]
    about = {
        "fruit": fruit,
        "recipe": repr(recipe),
        "torch": str(torch.__version__),
        **_source(photographs, start),
    }
    if trunk is not None:
        about["trunk"] = hashlib.sha256(trunk.read_bytes()).hexdigest()
    score = _fitted_score(
        making.detector(), recipe.fit, work, fruit, workers, photographs, rendered
    )
    save_compact(out, making.networks["finder"], making.networks["close_look"], about, score)
    round_weights(out, _shown(FrameFolder([held_out]), photographs))
    return out


def _shown(frames: FrameFolder, photographs: PhotoSet | None) -> Iterator[tuple[UInt8, Float64]]:
    """Pictures and camera matrices that show the ranges of the networks' values."""
    for index in range(min(SHOWN, len(frames))):
        yield frames.picture(index, halved=False), frames.annotation(index).K
    for photo in (
        () if photographs is None else photographs.train[:: max(1, len(photographs.train) // SHOWN)]
    ):
        yield photo.picture(), photo.K


def _fitted_score(
    detector: CompactDetector,
    fit: tuple[FrameSet, ...],
    work: Path,
    fruit: str,
    workers: int,
    photographs: PhotoSet | None,
    progress: Callable[[int, int], None] | None,
) -> FusedScore | None:
    folders = [work / f"fit_{k}" for k in range(len(fit))]
    for folder, frames in zip(folders, fit, strict=True):
        render_set(folder, frames, fruit, workers)
    domains = [frame_places(detector, FrameFolder(folders), progress)]
    if photographs is not None:
        some = photographs.train[::FITTED]
        domains.append(photo_places(detector, some, progress))
    return fit_score(domains)


class _Making:
    """The networks during a recipe, and the last stage of each of them."""

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
        trunk: Path | None,
    ) -> None:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)  # a run that is started again begins with the same weights
            self.networks: dict[str, Any] = {
                "finder": FinderNetwork(),
                "close_look": CloseLookNetwork(),
            }
        self._made_by: dict[str, int] = {}
        if start is not None:
            finder, close_look, _ = load_compact(start)
            self.networks["close_look"], self._made_by = close_look, {"close_look": -1}
            if isinstance(
                finder, FinderNetwork
            ):  # the finder of earlier weights cannot be learnt on
                self.networks["finder"], self._made_by["finder"] = finder, -1
        if trunk is not None:
            load_trunk(self.networks["finder"], trunk)
            self._made_by["finder"] = -1
        self._trained_trunk = "finder" in self._made_by
        self._work, self._held_out, self._folders = work, held_out, folders
        self._device, self._workers = device, workers
        self._rendered, self._photographs = rendered, photographs

    def detector(self) -> CompactDetector:
        self.networks = {name: network.cpu().eval() for name, network in self.networks.items()}
        return torch_detector(self.networks["finder"], self.networks["close_look"])

    def teach(
        self, number: int, stage: TrainingStage, say: Callable[[Progress], None] | None
    ) -> None:
        # Frames that were made before take the place of all sets.
        counts = (sum(stage.batch),) if len(self._folders) == 1 else stage.batch
        learnt_from = tuple(zip(self._folders, counts, strict=False))
        run = TrainingRun(
            stage.part,
            learnt_from,
            self._held_out,
            self._work / f"stage_{number}",
            _schedule(stage),
            seed=number,
            places=self._places(tuple(folder for folder, _ in learnt_from))
            if stage.part == "close_look"
            else None,
            start_from=self.networks[stage.part].state_dict()
            if stage.part in self._made_by
            else None,
            trained_trunk=stage.part == "finder" and self._trained_trunk,
            device=self._device,
            # A GPU waits for its batches; on a CPU the network itself needs the cores.
            workers=self._workers if self._device == "cuda" else min(1, self._workers),
            processes=1
            if self._device == "cuda"
            else max(1, min(self._workers, sum(stage.batch) // LEAST_SHARE)),
            turned=stage.turned,
            photographs=self._photographs,
            photos=stage.photos,
            empty=stage.empty,
            kept=stage.kept,
            jitter=stage.jitter,
        )
        self.networks[stage.part] = train_part(run, say)
        self._made_by[stage.part] = number

    def _places(self, learnt_from: tuple[Path, ...]) -> Path:
        """Where the finder sends the close look in rendered frames; found once."""
        file = self._work / f"places_{self._made_by['finder']}_{len(learnt_from)}.npz"
        if not file.is_file():
            save_places(
                file, find_places(self._searching(), FrameFolder(list(learnt_from)), self._rendered)
            )
        return file

    def _searching(self) -> CompactDetector:
        return torch_detector(self.networks["finder"].cpu(), self.networks["close_look"])


def _source(photographs: PhotoSet | None, start: Path | None) -> dict[str, str]:
    """Return the sources besides rendered frames, for the weights file."""
    about = {}
    if photographs is not None:
        boxes = sum(len(photograph.boxes) for photograph in photographs.train)
        about["photographs"] = f"{len(photographs.train)} with {boxes} boxes"
        if photographs.empty:
            about["pictures without fruit"] = str(len(photographs.empty))
    if start is not None:
        about["went on from"] = hashlib.sha256(start.read_bytes()).hexdigest()
    return about


def _schedule(stage: TrainingStage) -> Schedule:
    schedule = Schedule(
        stage.steps,
        stage.rate,
        stage.fall,
        stage.warm_up,
        method=stage.method,
        decay=stage.decay,
        clip=stage.clip,
        average=stage.average,
    )
    return (
        replace(schedule, validate_every=VALIDATE_EVERY, save_every=SAVE_EVERY)
        if stage.photos
        else schedule
    )


def render_set(
    folder: Path,
    frames: FrameSet,
    fruit: str,
    workers: int,
    rendered: Callable[[int, int], None] | None = None,
) -> None:
    """Render a set of frames into a folder; those that are there already are kept."""
    options = SceneOptions(
        kinds=frames.kinds,
        instances=frames.instances,
        lookalikes=frames.lookalikes,
        distractors=frames.distractors,
    )
    render_dataset(
        folder, frames.frames, frames.seed, fruit, options, workers=workers, progress=rendered
    )
