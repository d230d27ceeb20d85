"""`pomona train detect`: weights that find nothing are no success, and learning starts where it can."""

from __future__ import annotations

import re
import shutil
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from pomona.executive.cli import main as pomona  # noqa: E402
from pomona.skills.perception.detection.errors import BadTraining  # noqa: E402
from pomona.skills.perception.fruit import load_fruit  # noqa: E402
from pomona.skills.perception.fruit.catalogue import CATALOGUE  # noqa: E402
from pomona.tools.training import command_detector, recipe, report  # noqa: E402
from pomona.tools.training.evaluation import Evaluation, Match  # noqa: E402


def options(**said: Any) -> Namespace:
    plain = {
        "photos": None, "empty": None, "network": "compact", "quick": True, "steps": 0.001, "frames": None,
        "work": None,
        "fruit": "apple", "out": Path("w.weights"), "device": "cpu", "workers": 1, "data": None, "start_from": None,
        "trunk": None, "scales": False,
    }  # fmt: skip
    return Namespace(**{**plain, **said})


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Path | None]:
    """The weights from which each training begins; none is carried out."""
    starts: list[Path | None] = []
    monkeypatch.setattr(recipe, "make_weights", lambda *given: starts.append(given[10]))
    return starts


def measured(monkeypatch: pytest.MonkeyPatch, score: float) -> None:
    match = Match.__new__(Match)
    object.__setattr__(match, "visibility", 1.0)
    object.__setattr__(match, "score", score)
    result = Evaluation(200, (match,), ((1.0, 0.5, 0.08, "table"),), (), (0.01,))
    monkeypatch.setattr(report, "write_report", lambda *given, **more: result)


@pytest.mark.slow
def test_weights_that_find_nothing_are_no_success(started, monkeypatch, tmp_path, capsys) -> None:
    measured(monkeypatch, score=0.2)
    assert command_detector.train_main(options(work=tmp_path)) == 1
    assert "find no fruit in 200 held-out frames" in capsys.readouterr().err


def test_weights_that_find_fruit_are(started, monkeypatch, tmp_path) -> None:
    measured(monkeypatch, score=0.9)
    assert command_detector.train_main(options(work=tmp_path)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("fruit", ["apple", "lemon"])
def test_a_quick_training_starts_from_a_finder_that_can_be_learnt_on(
    fruit, started, monkeypatch, tmp_path
) -> None:
    measured(monkeypatch, score=0.9)
    command_detector.train_main(options(fruit=fruit, work=tmp_path))
    assert started == [load_fruit("apple").photo_weights]


def test_weights_that_cannot_be_learnt_on_are_refused_with_others(started) -> None:
    with pytest.raises(
        BadTraining, match=r"cannot be learnt on, that of .*apple_photographs.weights can"
    ):
        command_detector._start(options(start_from=load_fruit("apple").weights))


def test_many_scales_are_learnt_from_photographs_alone(
    started, monkeypatch, tmp_path, capsys
) -> None:
    assert command_detector.train_main(options(scales=True, work=tmp_path)) == 2
    assert "--scales goes with --photos" in capsys.readouterr().err
    recipes: list[Any] = []
    monkeypatch.setattr(recipe, "make_weights", lambda *given: recipes.append(given[3]))
    monkeypatch.setattr(command_detector, "_photographs", lambda *given: None)
    measured(monkeypatch, score=0.9)
    assert command_detector.train_main(options(scales=True, photos=[tmp_path], work=tmp_path)) == 0
    assert [stage.jitter for stage in recipes[0].stages] == [2.2]


def test_photographs_of_a_fruit_without_such_weights_are_refused() -> None:
    with pytest.raises(BadTraining, match="has none that can be learnt on"):
        command_detector._start(options(fruit="lemon", photos=[Path("photos")]))


TABLE = """include: sim.yaml
name: table
options: {include: "sim.yaml#options", fruit: tomato, skin: red}
world:
  include: sim.yaml#world
  fruits:
    tomato: {model: tomato, dimensions: [70 mm, 59 mm, 70 mm], mass: 150 g}
"""


@pytest.mark.long
def test_a_tomato_of_a_quick_training_is_found_and_picked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without photographs; takes a quarter of an hour to an hour."""
    monkeypatch.chdir(tmp_path)
    about = shutil.copytree(CATALOGUE / "tomato", tmp_path / "tomato") / "fruit.yaml"
    about.write_text(
        re.sub(r"^weights: .*$", "weights: tomato.weights", about.read_text(), flags=re.MULTILINE)
    )
    (tmp_path / "table.yaml").write_text(TABLE)
    order = [
        "train",
        "detect",
        "--fruit",
        "./tomato",
        "--quick",
        "--workers",
        "1",
        "--work",
        "work",
    ]
    assert pomona([*order, "--out", "tomato/tomato.weights"]) == 0
    (finder,) = re.findall(r"rendered AP50 ([\d.]+)", " ".join(capsys.readouterr().out.split()))
    assert float(finder) >= 0.85
    for seed in "123":
        pick = [
            "run",
            "pick_apple",
            "--cell",
            "table.yaml",
            "--set",
            "kind=./tomato",
            "--seed",
            seed,
        ]
        assert pomona(pick) == 0
        assert "lifted: yes" in capsys.readouterr().out
