"""Weights learnt on from proposed labels, kept only if neither bench gets worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.errors import BadTraining
from pomona.skills.perception.detection.weights_file import read_weights, write_weights
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.photographs.box_evaluation import box_figures
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.pytorch.networks import FinderNetwork
from pomona.tools.pytorch.weights import load_compact
from pomona.tools.training.evaluation import evaluate
from pomona.tools.training.loop import Progress
from pomona.tools.training.options import WITHOUT_TREES
from pomona.tools.training.photo_figures import find_boxes
from pomona.tools.training.recipe import (
    FIT,
    FrameSet,
    Recipe,
    TrainingStage,
    make_weights,
    render_set,
)
from pomona.tools.training.samples import FrameFolder

LEARN = Recipe(
    sets=(
        FrameSet(400, 61, (0.3, 0.2, 0.1, 0.4)),
        FrameSet(120, 62, (0.5, 0.25, 0.1, 0.15), (0, 2), lookalikes=10),
    ),
    held_out=FrameSet(40, 9001, WITHOUT_TREES),
    stages=(
        TrainingStage(
            "finder",
            200,
            4e-4,
            (5, 3),
            photos=8,
            average=0.985,
            warm_up=20,
            method="adam",
            decay=0.02,
            clip=10.0,
        ),
    ),
    fit=FIT,
)
"""The recipe of `pomona learn`: half rendered frames, so that rendered fruit is not forgotten."""

BENCH = FrameSet(
    200, 9201, WITHOUT_TREES
)  # rendered frames on which weights before and after are compared
SCORE = 0.6  # score at which rendered frames are judged, the default of Detect's `score`
LEAST_LABELS = 20  # least number of labels to learn from, and to measure on: fewer decide nothing


@dataclass(frozen=True, slots=True)
class BenchFigures:
    """Figures of one weights file."""

    rendered_recall: float  # rendered_recall, rendered_precision: on `BENCH` at `SCORE`
    rendered_precision: float
    photo_recall: float  # on the photographs to measure on, at precision 0.90
    photo_ap50: float  # their AP50

    def is_no_worse(self, before: BenchFigures) -> bool:
        """Return True where no figure is below that of `before`."""
        return all(
            getattr(self, name) >= getattr(before, name) for name in self.__dataclass_fields__
        )

    def text(self) -> str:
        """Return the figures in one line."""
        return (
            f"rendered recall {self.rendered_recall:.4f}, precision {self.rendered_precision:.4f} at score {SCORE}; "
            f"photographs: recall at precision 0.90 {self.photo_recall:.4f}, AP50 {self.photo_ap50:.4f}"
        )


@dataclass(frozen=True, slots=True)
class Learnt:
    """Outcome: the figures before and after, and whether the new weights are kept."""

    before: BenchFigures
    after: BenchFigures

    @property
    def is_kept(self) -> bool:
        """Return True where the new weights are written."""
        return self.after.is_no_worse(self.before)


def learn(
    out: Path,
    work: Path,
    photographs: PhotoSet,
    start: Path,
    fruit: str = "apple",
    recipe: Recipe = LEARN,
    bench: FrameSet = BENCH,
    workers: int = 1,
    say: Callable[[str, Progress], None] | None = None,
) -> Learnt:
    """Learn on from weights, and write the new ones only if neither bench is worse.

    Args:
        out: weights file, with a model card of the same name beside it.
        work: folder for frames and checkpoints; a run that was cut off goes on there.
        photographs: proposed labels.
        start: weights to learn on from.
        fruit: name in the catalogue.
        recipe: sets and stage.
        bench: rendered frames to compare on.
        workers: as of `make_weights`.
        say: called with the stage's name and its progress.

    Raises:
        BadTraining: too few labels, or weights whose finder cannot be learnt on.
        BadWeights: `start` cannot be read.
    """
    check_start(start)
    for some, use in ((photographs.train, "learn from"), (photographs.val, "measure on")):
        labels = sum(int((~photo.crowd).sum()) for photo in some)
        if labels < LEAST_LABELS:
            raise BadTraining(
                f"{labels} labels to {use}, expected at least {LEAST_LABELS}: record more runs"
            )
    new = work / "new.weights"
    make_weights(
        new, work, fruit, recipe, workers=workers, photographs=photographs, start=start, say=say
    )
    render_set(work / "bench", bench, fruit, max(1, workers))
    learnt = Learnt(*(_figures(path, work / "bench", fruit, photographs) for path in (start, new)))
    if learnt.is_kept:
        stored = read_weights(new)
        about = {
            **stored.about,
            "bench before": learnt.before.text(),
            "bench after": learnt.after.text(),
        }
        out.with_suffix(".md").write_text(_card(out, start, about), encoding="utf-8")
        write_weights(out, replace(stored, about=about))
    return learnt


def check_start(start: Path) -> None:
    """Refuse weights whose finder cannot be learnt on.

    Raises BadTraining: the finder is of an earlier kind; BadWeights: the file cannot be read.
    """
    if not isinstance(load_compact(start)[0], FinderNetwork):
        raise BadTraining(
            f"the finder of {start.name} is of an older kind that cannot be trained further: name weights of "
            "`pomona train detect --photos` with --start-from"
        )


def _figures(weights: Path, bench: Path, fruit: str, photographs: PhotoSet) -> BenchFigures:
    detector = CompactDetector.load(weights)
    frames = FrameFolder([bench])
    rendered = evaluate(detector, frames, load_fruit(fruit), len(frames))
    # Doubtful boxes are no labels: detections there count as wrong for both weights alike.
    val = [
        replace(
            photo,
            boxes=photo.boxes[~photo.crowd],
            crowd=np.zeros(int((~photo.crowd).sum()), np.bool_),
        )
        for photo in photographs.val
    ]
    found = box_figures([finds.judged() for finds in find_boxes(detector, val)])
    return BenchFigures(rendered.recall(SCORE), rendered.precision(SCORE), found.recall, found.ap50)


def _card(out: Path, start: Path, about: dict[str, str]) -> str:
    rows = "\n".join(f"| {key} | {value.replace('|', ' ')} |" for key, value in about.items())
    return f"# {out.name}\n\nLearnt on from `{start.name}` by `pomona learn`.\n\n| | |\n|---|---|\n{rows}\n"
