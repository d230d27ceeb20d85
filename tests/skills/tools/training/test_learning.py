"""Weights learnt on from proposals: kept when no figure is worse; and the refusals."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.skills.perception.detection.errors import BadTraining
from pomona.skills.perception.detection.weights_file import read_weights
from pomona.skills.perception.fruit.catalogue import SHIPPED_WEIGHTS
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import save_compact
from pomona.tools.training import learning
from pomona.tools.training.learning import BenchFigures, learn
from pomona.tools.training.recipe import FrameSet, Recipe, TrainingStage
from tests.skills.tools.photographs.photo_folders import tables

BEFORE = BenchFigures(0.98, 0.97, 0.8, 0.85)


@pytest.fixture
def photographs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PhotoSet:
    monkeypatch.setattr(learning, "LEAST_LABELS", 1)
    return read_photographs(tables(tmp_path / "photographs"))


@pytest.fixture
def start(tmp_path: Path) -> Path:
    path = tmp_path / "start.weights"
    save_compact(path, FinderNetwork(), CloseLookNetwork((8, 8, 8, 8, 8)), {"fruit": "apple"})
    return path


def trained(monkeypatch: pytest.MonkeyPatch, after: BenchFigures) -> None:
    """Replace the training, which takes minutes, and the benches by their outcome."""

    def make(out: Path, work: Path, *_: object, start: Path, **__: object) -> Path:
        work.mkdir(parents=True, exist_ok=True)
        out.write_bytes(start.read_bytes())
        return out

    figures = iter((BEFORE, after))
    monkeypatch.setattr(learning, "make_weights", make)
    monkeypatch.setattr(learning, "render_set", lambda *_: None)
    monkeypatch.setattr(learning, "_figures", lambda *_: next(figures))


@pytest.mark.slow
def test_weights_that_are_no_worse_are_kept_with_both_benches_in_the_card(
    photographs: PhotoSet, start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained(monkeypatch, replace(BEFORE, photo_recall=0.9))
    out = tmp_path / "learnt.weights"
    assert learn(out, tmp_path / "work", photographs, start).is_kept
    about = read_weights(out).about
    assert "recall at precision 0.90 0.8000" in about["bench before"]
    assert "recall at precision 0.90 0.9000" in about["bench after"]
    assert about["bench after"] in out.with_suffix(".md").read_text()


@pytest.mark.parametrize(
    "name", ["rendered_recall", "rendered_precision", "photo_recall", "photo_ap50"]
)
@pytest.mark.slow
def test_weights_with_any_figure_that_is_worse_are_not_written(
    photographs: PhotoSet, start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    better = {field: value + 0.01 for field, value in asdict(BEFORE).items()}
    trained(monkeypatch, BenchFigures(**{**better, name: getattr(BEFORE, name) - 0.001}))
    before = start.read_bytes()
    assert not learn(tmp_path / "learnt.weights", tmp_path / "work", photographs, start).is_kept
    assert not list(tmp_path.glob("learnt.*"))
    assert start.read_bytes() == before


@pytest.mark.slow
def test_a_finder_of_an_earlier_kind_is_refused(photographs: PhotoSet, tmp_path: Path) -> None:
    with pytest.raises(BadTraining, match=r"the finder of apple\.weights is of an older kind"):
        learn(
            tmp_path / "learnt.weights",
            tmp_path / "work",
            photographs,
            SHIPPED_WEIGHTS / "apple.weights",
        )


@pytest.mark.slow
def test_too_few_labels_are_refused_before_anything_is_learnt(
    photographs: PhotoSet, start: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "LEAST_LABELS", 3)
    with pytest.raises(BadTraining, match="1 labels to measure on, expected at least 3"):
        learn(tmp_path / "learnt.weights", tmp_path / "work", photographs, start)
    doubtful = [
        replace(photo, crowd=np.ones(len(photo.boxes), np.bool_)) for photo in photographs.train
    ]
    with pytest.raises(BadTraining, match="0 labels to learn from"):
        learn(
            tmp_path / "learnt.weights",
            tmp_path / "work",
            replace(photographs, train=tuple(doubtful)),
            start,
        )
    assert not (tmp_path / "work").exists()


@pytest.mark.long
def test_a_short_run_learns_measures_both_and_writes_only_its_result(
    photographs: PhotoSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.set_num_threads(1)
    stage = TrainingStage("finder", 2, 1e-4, (1,), photos=1, average=0.9, method="adam")
    recipe = Recipe((FrameSet(2, 5),), FrameSet(1, 7), (stage,), (FrameSet(2, 8),))
    out, start = tmp_path / "learnt.weights", SHIPPED_WEIGHTS / "apple_photographs.weights"
    learnt = learn(
        out, tmp_path / "work", photographs, start, recipe=recipe, bench=FrameSet(2, 9), workers=0
    )
    assert 0.0 < learnt.before.rendered_recall <= 1.0
    assert out.exists() == learnt.is_kept
    assert read_weights(tmp_path / "work" / "new.weights").about["photographs"] == "2 with 4 boxes"
