"""`pomona data detect` and `pomona train detect`, from the command line to files."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")

from pomona.executive.cli import main as pomona  # noqa: E402
from pomona.executive.errors import UsageError  # noqa: E402
from pomona.executive.values.installation import install_extra  # noqa: E402
from pomona.skills.perception.detection.weights_file import read_weights  # noqa: E402
from pomona.skills.perception.fruit import load_fruit  # noqa: E402
from pomona.skills.perception.fruit.catalogue import CATALOGUE  # noqa: E402
from pomona.tools.pytorch.weights import load_compact  # noqa: E402
from pomona.tools.training import recipe, report  # noqa: E402
from pomona.tools.training.annotations import read_annotation  # noqa: E402
from pomona.tools.training.command_detector import add_data, add_train  # noqa: E402
from pomona.tools.training.evaluation import Evaluation, Match  # noqa: E402
from pomona.tools.training.finder_samples import FinderBatches  # noqa: E402
from pomona.tools.training.loop import Schedule  # noqa: E402
from pomona.tools.training.recipe import FrameSet, Recipe, TrainingStage  # noqa: E402

pytestmark = pytest.mark.slow


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    subparsers = parser.add_subparsers(required=True)
    add_data(subparsers)
    add_train(subparsers)
    options = parser.parse_args(arguments)
    code: int = options.main(options)
    return code


@pytest.mark.slow
def test_data_renders_frames_and_keeps_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("data", "detect", "--out", str(tmp_path), "--frames", "2", "--workers", "1")
    assert run(*arguments) == 0
    assert run(*arguments) == 0
    assert "0 frames rendered, 2 kept" in " ".join(capsys.readouterr().out.split())
    annotation = read_annotation(tmp_path / "000000.json")
    assert (annotation.width, annotation.height) == (640, 480)


def test_frames_of_an_unknown_fruit_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("data", "detect", "--out", str(tmp_path), "--fruit", "durian", "--frames", "1")
    assert run(*arguments, "--workers", "1") == 2
    complaint = capsys.readouterr().err
    assert "no fruit named 'durian'" in complaint
    assert complaint.count("\n") == 1


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both recipes, in a few steps."""
    torch.set_num_threads(1)
    stages = (
        TrainingStage("finder", Schedule(3, 1e-3, validate_every=1), (2,)),
        TrainingStage("close_look", Schedule(2, 1e-3), (4,)),
        TrainingStage("close_look", Schedule(1, 1e-3), (2, 2)),
    )
    sets = (FrameSet(4, 5), FrameSet(2, 6, (0.0, 0.0, 0.0, 1.0)))
    made = Recipe(sets, FrameSet(2, 7), stages)
    monkeypatch.setattr(recipe, "SHIPPED", made)
    monkeypatch.setattr(recipe, "QUICK", made)


def places(work: Path) -> tuple[str, ...]:
    out = str(work / "apple.weights")
    return ("train", "detect", "--out", out, "--work", str(work), "--workers", "0")


@pytest.mark.long
def test_train_makes_weights_and_a_report_and_an_interrupted_run_ends_the_same(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert run(*places(whole), "--quick", "--frames", "3") in (0, 1)
    shown = " ".join(capsys.readouterr().out.split())
    assert "close_look 3/3" in shown
    assert "held-out loss" in shown
    assert [len(list((whole / f"frames_{k}").glob("*.json"))) for k in range(2)] == [2, 1]
    assert {p.name for p in whole.glob("places*")} == {"places_1.npz", "places_2.npz"}
    stored, start = read_weights(whole / "apple.weights"), load_fruit("apple").photo_weights
    assert start is not None
    assert stored.about["fruit"] == "apple"
    assert stored.scores.content() == read_weights(start).scores.content()
    assert "recall" in (whole / "report" / "report.md").read_text()
    assert (whole / "report" / "frame_0.jpg").stat().st_size > 1000

    original = FinderBatches.__getitem__

    def until_two(self: FinderBatches, step: int) -> Any:
        if step == 2 and self._steps == 3:
            raise KeyboardInterrupt
        return original(self, step)

    with monkeypatch.context() as patched:
        patched.setattr(FinderBatches, "__getitem__", until_two)
        with pytest.raises(KeyboardInterrupt):
            run(*places(cut), "--quick", "--frames", "3")
    assert not (cut / "apple.weights").exists()
    run(*places(cut), "--quick", "--frames", "3")
    networks = (load_compact(folder / "apple.weights") for folder in (whole, cut))
    for network, again in zip(*networks, strict=True):
        for a, b in zip(network.state_dict().values(), again.state_dict().values(), strict=True):
            assert torch.equal(a, b)


def test_training_on_bad_input_prints_one_line_and_touches_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    work, old = tmp_path / "work", tmp_path / "old.pt"
    work.mkdir()
    (work / "apple.weights").write_bytes(b"weights of yesterday")
    torch.save({"format": "pomona compact detector 1"}, old)
    for arguments, words in (
        (("--start-from", str(old)), "old.pt: is not a 'pomona compact detector 3' file"),
        (("--start-from", str(tmp_path / "none.weights")), "none.weights: no such file"),
        (("--start-from", str(load_fruit("apple").weights)), "cannot be learnt on; that of"),
        (("--fruit", "durian"), "durian"),
    ):
        assert run(*places(work), *arguments) == 2
        complaint = capsys.readouterr().err
        assert words in complaint
        assert complaint.count("\n") == 1
    assert [path.name for path in work.iterdir()] == ["apple.weights"]
    assert (work / "apple.weights").read_bytes() == b"weights of yesterday"


def test_training_without_pytorch_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    words = re.escape(f"pomona train needs the extra 'torch': {install_extra('torch')}")
    with pytest.raises(UsageError, match=words):
        run("train", "detect")


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Path | None]:
    """The weights from which each training begins; none is carried out."""
    starts: list[Path | None] = []
    monkeypatch.setattr(recipe, "make_weights", lambda *given: starts.append(given[6]))
    return starts


def measured(monkeypatch: pytest.MonkeyPatch, score: float) -> None:
    match = Match(1.0, score, 1.0, 1.0, 0.1, 1.0, 1.0)
    result = Evaluation(200, (match,), (1.0,), (), (0.01,))
    monkeypatch.setattr(report, "write_report", lambda *given: result)


def test_weights_that_find_nothing_are_no_success(started, monkeypatch, tmp_path, capsys) -> None:
    measured(monkeypatch, score=0.2)
    assert run(*places(tmp_path)) == 1
    assert "find no fruit in 200 held-out frames" in capsys.readouterr().err
    measured(monkeypatch, score=0.9)
    assert run(*places(tmp_path)) == 0
    assert started == [None, None]


@pytest.mark.parametrize("fruit", ["apple", "lemon"])
def test_a_quick_training_starts_from_a_finder_that_can_be_learnt_on(
    fruit, started, monkeypatch, tmp_path
) -> None:
    measured(monkeypatch, score=0.9)
    assert run(*places(tmp_path), "--quick", "--fruit", fruit) == 0
    assert started == [load_fruit("apple").photo_weights]


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
    """Takes a quarter of an hour to an hour."""
    monkeypatch.chdir(tmp_path)
    about = shutil.copytree(CATALOGUE / "tomato", tmp_path / "tomato") / "fruit.yaml"
    about.write_text(
        re.sub(r"^weights: .*$", "weights: tomato.weights", about.read_text(), flags=re.MULTILINE)
    )
    (tmp_path / "table.yaml").write_text(TABLE)
    order = ("train", "detect", "--fruit", "./tomato", "--quick", "--workers", "1")
    assert pomona([*order, "--work", "work", "--out", "tomato/tomato.weights"]) == 0
    written = (tmp_path / "work" / "report" / "report.md").read_text()
    figures = re.search(r"\| 0\.5 \| ([\d.]+) \| ([\d.]+) \|", written)
    assert figures is not None
    assert float(figures[1]) >= 0.85
    assert float(figures[2]) >= 0.75
    for seed in "123":
        pick = ("run", "pick_apple", "--cell", "table.yaml", "--set", "kind=./tomato")
        assert pomona([*pick, "--seed", seed]) == 0
        assert "lifted: yes" in capsys.readouterr().out
