"""`pomona data detect`, `pomona train detect` and `pomona export-weights`, from the command line to files."""

import argparse
import json
import re
import sys
from pathlib import Path

import pytest
import torch

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import install_extra
from pomona.skills.perception.detection.weights_file import read_weights
from pomona.tools.pytorch.networks import BeliefFinder, CloseLookNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact
from pomona.tools.training import recipe
from pomona.tools.training.annotations import read_annotation
from pomona.tools.training.command_detector import add_data, add_export, add_train
from pomona.tools.training.finder_samples import FinderBatches
from pomona.tools.training.recipe import FrameSet, Recipe, TrainingStage
from tests.skills.tools.photographs.photo_folders import tables

pytestmark = pytest.mark.slow


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    subparsers = parser.add_subparsers(required=True)
    add_data(subparsers)
    add_train(subparsers)
    add_export(subparsers)
    options = parser.parse_args(arguments)
    code: int = options.main(options)
    return code


def test_data_renders_frames_and_keeps_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
    )
    assert run(*arguments) == 0
    assert run(*arguments) == 0
    assert "0 frames rendered, 2 kept" in " ".join(capsys.readouterr().out.split())
    annotation = read_annotation(tmp_path / "000000.json")
    assert (annotation.width, annotation.height) == (320, 240)
    assert annotation.camera[0] == pytest.approx(305.3)


def test_data_renders_the_kinds_that_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
        assert f"argument --kinds: '{wrong}' is not a number" in capsys.readouterr().err


@pytest.mark.long
def test_train_makes_weights_and_a_report_with_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    torch.set_num_threads(1)
    stages = (
        TrainingStage("finder", 1, 1e-3, (2,)),
        TrainingStage("close_look", 2, 1e-3, (4,)),
        TrainingStage("finder", 1, 1e-3, (1, 1)),
        TrainingStage("close_look", 1, 1e-3, (2, 2)),
    )
    sets = (FrameSet(8, 5), FrameSet(4, 6, (0.0, 0.0, 0.0, 1.0)))
    monkeypatch.setattr(recipe, "SHIPPED", Recipe(sets, FrameSet(2, 7), stages, (FrameSet(2, 8),)))
    out = tmp_path / "apple.weights"
    arguments = (
        "--out",
        str(out),
        "--work",
        str(tmp_path / "work"),
        "--workers",
        "1",
        "--frames",
        "3",
    )
    assert run("train", "detect", *arguments) == 0
    rendered = [len(list((tmp_path / "work" / f"frames_{k}").glob("*.json"))) for k in range(2)]
    assert rendered == [2, 1]
    assert {p.name for p in (tmp_path / "work").glob("places*")} == {
        "places_0_1.npz",
        "places_2_2.npz",
    }
    _, _, about = load_compact(out)
    assert about["fruit"] == "apple"
    report = (tmp_path / "work" / "report" / "report.md").read_text()
    assert "recall" in report
    assert (tmp_path / "work" / "report" / "frame_0.jpg").stat().st_size > 1000
    assert "close_look 4/4" in capsys.readouterr().out


def test_the_full_network_needs_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("train", "detect", "--network", "dope", "--out", str(tmp_path / "dope.pth")) == 2
    assert "--data" in capsys.readouterr().err


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recipe with photographs, in a few steps."""
    torch.set_num_threads(1)
    stages = (TrainingStage("finder", 3, 1e-3, (2,), photos=2, average=0.9),)
    small = Recipe((FrameSet(2, 5),), FrameSet(1, 7), stages, (FrameSet(2, 8),))
    monkeypatch.setattr(recipe, "WITH_PHOTOGRAPHS", small)
    monkeypatch.setattr(recipe, "SAVE_EVERY", 1)


def photo_arguments(folder: Path, work: Path) -> tuple[str, ...]:
    return (
        "--photos",
        str(folder),
        "--work",
        str(work),
        "--out",
        str(work / "apple.weights"),
        "--workers",
        "0",
    )


@pytest.mark.long
def test_train_goes_on_from_photographs_and_an_interrupted_run_ends_the_same(
    small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tables(tmp_path / "photographs")
    assert run("train", "detect", *photo_arguments(folder, tmp_path / "whole")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "2 photographs with 4 boxes to learn from, 2 photographs with 1 boxes to measure on" in said
    )
    assert "recall at precision 0.90" in said
    report = (tmp_path / "whole" / "report" / "report.md").read_text()
    assert "2 photographs with 1 boxes" in report
    assert (tmp_path / "whole" / "report" / "photograph_worst_0.jpg").stat().st_size > 1000
    assert (tmp_path / "whole" / "report" / "curves.png").stat().st_size > 1000

    original = FinderBatches.__getitem__

    def until_two(self: FinderBatches, step: int) -> tuple[torch.Tensor, ...]:
        if step == 2:
            raise KeyboardInterrupt
        return original(self, step)

    with monkeypatch.context() as patched:
        patched.setattr(FinderBatches, "__getitem__", until_two)
        with pytest.raises(KeyboardInterrupt):
            run("train", "detect", *photo_arguments(folder, tmp_path / "cut"))
    assert not (tmp_path / "cut" / "apple.weights").exists()
    assert run("train", "detect", *photo_arguments(folder, tmp_path / "cut")) == 0
    whole, resumed = (load_compact(tmp_path / name / "apple.weights") for name in ("whole", "cut"))
    for network, again in zip(whole[:2], resumed[:2], strict=True):
        for a, b in zip(network.state_dict().values(), again.state_dict().values(), strict=True):
            assert torch.equal(a, b)
    assert whole[2]["photographs"] == "2 with 4 boxes"
    assert (
        len({read_weights(tmp_path / name / "apple.weights").scores for name in ("whole", "cut")})
        == 1
    )


def test_training_on_bad_input_prints_one_line_and_touches_nothing(
    small: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, work = tables(tmp_path / "photographs"), tmp_path / "work"
    work.mkdir()
    (work / "apple.weights").write_bytes(b"weights of yesterday")
    old = tmp_path / "old.pt"
    torch.save({"format": "pomona compact detector 1"}, old)
    table = (folder / "fruit.csv").read_text()
    for arguments, says in (
        (photo_arguments(tmp_path / "elsewhere", work), "elsewhere: no such folder"),
        (
            (*photo_arguments(folder, work), "--start-from", str(old)),
            "old.pt: is not a 'pomona compact detector 2'",
        ),
        (
            (*photo_arguments(folder, work), "--start-from", str(tmp_path / "none.weights")),
            "none.weights: no such file",
        ),
        ((*photo_arguments(folder, work), "--fruit", "durian"), "durian"),
        (
            (*photo_arguments(folder, work), "--empty", str(tmp_path / "bare")),
            "bare: no such folder",
        ),
        (
            (*photo_arguments(folder, work), "--trunk", str(tmp_path / "none.pth")),
            "none.pth: no such file",
        ),
        (
            (*photo_arguments(folder, work), "--trunk", str(old)),
            "old.pt: holds no _conv_stem.weight",
        ),
        (("--empty", str(folder)), "--empty goes with --photos"),
    ):
        assert run("train", "detect", *arguments) == 2
        complaint = capsys.readouterr().err
        assert says in complaint
        assert complaint.count("\n") == 1
    (folder / "fruit.csv").write_text(table + "a_0.jpg,500,20,30,30\n")
    assert run("train", "detect", *photo_arguments(folder, work)) == 2
    assert "line 7: the box at 500, 20" in capsys.readouterr().err
    assert [path.name for path in work.iterdir()] == ["apple.weights"]
    assert (work / "apple.weights").read_bytes() == b"weights of yesterday"


def test_weights_are_exported_in_one_command_and_others_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "small.weights"
    save_compact(
        small, BeliefFinder((8, 8, 8, 8)), CloseLookNetwork((8, 8, 8, 8, 8)), {"fruit": "apple"}
    )
    out = tmp_path / "onnx"
    assert run("export-weights", "--onnx", "--weights", str(small), "--out", str(out)) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "about.json",
        "close_look.onnx",
        "finder.onnx",
    ]
    assert json.loads((out / "about.json").read_text())["about"] == {"fruit": "apple"}
    assert (
        run("export-weights", "--weights", str(small), "--out", str(tmp_path / "copy.weights")) == 0
    )
    assert read_weights(tmp_path / "copy.weights") == read_weights(small)
    capsys.readouterr()
    for arguments, says in (
        (("--onnx", "--weights", str(tmp_path / "none.weights")), "none.weights: no such file"),
        (("--onnx", "--fruit", "durian"), "durian"),
        (("--weights", str(small)), "other: is there already: name another file with --out"),
    ):
        (tmp_path / "other").touch()
        assert run("export-weights", *arguments, "--out", str(tmp_path / "other")) == 2
        complaint = capsys.readouterr().err
        assert says in complaint
        assert complaint.count("\n") == 1


def test_training_without_pytorch_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(
        UsageError,
        match=re.escape(f"pomona train needs the extra 'torch': {install_extra('torch')}"),
    ):
        run("train", "detect")
