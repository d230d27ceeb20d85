"""`pomona data detect` and `pomona train detect`, from the command line to files."""

import argparse
from pathlib import Path

import pytest
import torch

from skills.commands.detector import add_data, add_train
from skills.perception.detection.annotations import read_annotation
from skills.perception.detection.weights import load_compact
from skills.perception.training import recipe
from skills.perception.training.recipe import FrameSet, Recipe, Stage


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    subparsers = parser.add_subparsers(required=True)
    add_data(subparsers)
    add_train(subparsers)
    options = parser.parse_args(arguments)
    code: int = options.main(options)
    return code


def test_data_renders_frames_and_keeps_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("data", "detect", "--out", str(tmp_path), "--frames", "2", "--workers", "1", "--width", "320")
    assert run(*arguments) == 0
    assert run(*arguments) == 0
    assert "0 frames rendered, 2 kept" in " ".join(capsys.readouterr().out.split())
    annotation = read_annotation(tmp_path / "000000.json")
    assert (annotation.width, annotation.height) == (320, 240)
    assert annotation.camera[0] == pytest.approx(305.3)


def test_data_renders_the_kinds_that_are_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (
        "data",
        "detect",
        "--out",
        str(tmp_path),
        "--frames",
        "2",
        "--workers",
        "1",
        "--width",
        "320",
        "--kinds",
    )
    assert run(*arguments, "0", "0", "0", "1") == 0
    assert {read_annotation(path).scene for path in tmp_path.glob("*.json")} == {"tree"}
    assert run(*arguments, "0", "0", "0", "0") == 2
    assert "--kinds" in capsys.readouterr().err
    for wrong in ("nan", "many"):
        with pytest.raises(SystemExit):
            run(*arguments, "0", wrong, "0", "1")
        assert f"{wrong} is not a number of at least 0" in capsys.readouterr().err


def test_train_makes_weights_and_a_report_with_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    torch.set_num_threads(1)
    stages = (
        Stage("finder", 1, 1e-3, 2),
        Stage("close_look", 2, 1e-3, 4),
        Stage("finder", 1, 1e-3, 2, sets=2),
        Stage("close_look", 1, 1e-3, 4, sets=2),
    )
    sets = (FrameSet(8, 5), FrameSet(4, 6, (0.0, 0.0, 0.0, 1.0)))
    monkeypatch.setattr(recipe, "SHIPPED", Recipe(sets, FrameSet(2, 7), stages))
    out = tmp_path / "apple.pt"
    arguments = ("--out", str(out), "--work", str(tmp_path / "work"), "--workers", "1", "--frames", "3")
    assert run("train", "detect", *arguments) == 0
    rendered = [len(list((tmp_path / "work" / f"frames_{k}").glob("*.json"))) for k in range(2)]
    assert rendered == [2, 1]
    assert {p.name for p in (tmp_path / "work").glob("places*")} == {"places_0_1.npz", "places_2_2.npz"}
    _, _, about = load_compact(out)
    assert about["fruit"] == "apple"
    report = (tmp_path / "work" / "report" / "report.md").read_text()
    assert "recall" in report
    assert (tmp_path / "work" / "report" / "frame_0.jpg").stat().st_size > 1000
    assert "close_look 4/4" in capsys.readouterr().out


def test_the_full_network_needs_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("train", "detect", "--network", "dope", "--out", str(tmp_path / "dope.pth")) == 2
    assert "--data" in capsys.readouterr().err
