"""`pomona learn`: frames and picks of a record, and input that cannot be used."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.executive.running.events import Event, NodeChanged, Published, RunStarted
from pomona.executive.views import ImageView, Line2, Pinhole
from pomona.tools.training import command_learn as learn
from pomona.tools.training.proposals import RecordedLook


def run(*arguments: object) -> int:
    parser = argparse.ArgumentParser()
    learn.add(parser.add_subparsers(required=True))
    options = parser.parse_args(["learn", *map(str, arguments)])
    code: int = options.main(options)
    return code


def started() -> Event:
    nodes = ({"path": "pick/Lift", "type": "Lift"}, {"path": "pick/Detect", "type": "Detect"})
    words: dict[str, Any] = dict.fromkeys(
        (
            "run",
            "tree",
            "tree_path",
            "tree_text",
            "tree_hash",
            "cell",
            "cell_kind",
            "cell_path",
            "cell_text",
        ),
        "",
    )
    return RunStarted(
        0.0, 0, **words, seed=0, parameters={}, nodes=nodes, versions={}, wall_time=0.0, period=0.01
    )


def shown(chosen: tuple[float, float] | None, depth: bool = True) -> Event:
    lines = [Line2(np.full((16, 2), 400.0), "1: 0.80", "muted")]
    if chosen is not None:
        corners = np.array(chosen) + np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]])
        lines.insert(0, Line2(np.tile(corners, (4, 1)), "0: 0.90", "found"))
    measured = np.ones((48, 64), np.float32) if depth else None
    view = ImageView(
        np.zeros((48, 64, 3), np.uint8),
        tuple(lines),
        depth=measured,
        pinhole=Pinhole(60, 61, 32, 24),
    )
    return Published(1.0, 100, "pick/Detect", "detection", view)


def lifted(status: str, path: str = "pick/Lift") -> Event:
    return NodeChanged(2.0, 200, path, status, "", 1)


def looks_of(monkeypatch: pytest.MonkeyPatch, *events: Event) -> list[RecordedLook]:
    monkeypatch.setattr(learn, "read_events", lambda _record: iter((started(), *events)))
    return list(learn.recorded_looks(Path("runs/pick_1")))


def test_the_chosen_fruit_of_a_look_is_picked_when_it_was_lifted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, second, third = looks_of(
        monkeypatch,
        shown((20.0, 30.0)),
        lifted("FAILURE"),
        shown((40.0, 10.0)),
        lifted("SUCCESS", "pick/Detect"),
        lifted("SUCCESS"),
        lifted("SUCCESS"),
        shown(None),
        lifted("SUCCESS"),
    )
    assert (len(first.picked), len(third.picked)) == (0, 0)
    assert np.allclose(second.picked, [[40.0, 10.0]])
    assert np.allclose(second.K, [[60.0, 0.0, 32.0], [0.0, 61.0, 24.0], [0.0, 0.0, 1.0]])
    assert (second.run, second.colour.shape, second.depth.shape) == (
        "pick_1",
        (48, 64, 3),
        (48, 64),
    )


def test_frames_without_depth_teach_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert looks_of(monkeypatch, shown((20.0, 30.0), depth=False), lifted("SUCCESS")) == []


@pytest.mark.slow
def test_input_that_cannot_be_used_is_one_line_and_writes_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = tmp_path / "pick_1"
    record.mkdir()
    (record / "run.mcap").touch()
    monkeypatch.setattr(learn, "read_events", lambda _record: iter((started(),)))
    there = tmp_path / "there.weights"
    there.write_text("mine")
    for arguments, said in (
        (("--start-from", "apple.weights"), "apple.weights: no such file"),
        (("--fruit", "lemon"), "the finder of lemon.weights is of an older kind"),
        (("--fruit", "durian"), "durian"),
        (("--out", there), "there.weights is there already"),
        ((), "no run has a frame with depth in which Detect searched"),
    ):
        assert run(record, "--work", tmp_path / "work", *arguments) == 2
        complaint = capsys.readouterr().err
        assert said in complaint
        assert complaint.count("\n") == 1
    assert there.read_text() == "mine"
    assert not (tmp_path / "work").exists()
