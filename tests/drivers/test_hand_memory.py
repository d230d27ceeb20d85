"""State of a hand between two connections, and a file of it that is damaged or cannot be written."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from pomona.drivers.hold_watch import HandMemory, HandRecord, memory_of

BIAS = {"f1": (1.5, 1.25), "f2": (0.5, 0.125)}


def test_another_process_finds_the_newest_bias_and_state_of_the_hand(tmp_path: Path) -> None:
    path = tmp_path / "state" / "hand.json"
    memory = HandMemory(path)
    assert memory.record is None
    memory.keep_bias(BIAS, 0.09)
    memory.keep_hand("something is between the fingers", 0.073)
    assert HandMemory(path).record == HandRecord("something is between the fingers", 0.073, BIAS)
    assert [file.name for file in path.parent.iterdir()] == ["hand.json"]


def test_a_new_bias_means_that_the_hand_is_empty() -> None:
    memory = HandMemory(None)
    memory.keep_hand("something is between the fingers", 0.073)
    memory.keep_bias(BIAS, 0.103)
    assert memory.record == HandRecord("", 0.103, BIAS)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{", '{"format": "pomona hand 1"}', '{"format": "other", "held": "", "width": 0.1, "bias": {}}',
     '{"format": "pomona hand 1", "held": "", "width": NaN, "bias": {}}',
     '{"format": "pomona hand 1", "held": "", "width": 0.1, "bias": {"f1": [Infinity]}}',
     '{"format": "pomona hand 1", "held": "", "width": 0.1, "bias": {}, "opens_to": Infinity}',
     '{"format": "pomona hand 1", "held": "", "width": null, "bias": {}}'],
)  # fmt: skip
def test_a_damaged_file_is_no_record(tmp_path: Path, text: str) -> None:
    path = tmp_path / "hand.json"
    path.write_text(text)
    assert HandMemory(path).record is None


def test_a_file_that_cannot_be_replaced_is_removed_and_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "hand.json"
    memory = HandMemory(path)
    memory.keep_bias(BIAS, 0.09)

    def full(_self: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with caplog.at_level(logging.WARNING):
        memory.keep_hand("something is between the fingers", 0.073)
        memory.keep_hand("", 0.1)
    assert caplog.text.count("No space left on device") == 1
    assert list(tmp_path.iterdir()) == []
    assert HandMemory(path).record is None
    assert memory.record == HandRecord("", 0.1, BIAS)  # this process goes on with what it knows


def test_the_same_wires_lead_to_the_same_file_in_the_users_state_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    memory_of(["/dev/ttyUSB1", "/dev/ttyUSB0"]).keep_hand("", 0.1)
    assert memory_of(["/dev/ttyUSB0", "/dev/ttyUSB1"]).record == HandRecord("", 0.1)
    assert memory_of(["/dev/ttyUSB0", "/dev/ttyUSB2"]).record is None
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    path = memory_of(["a"]).path
    assert path is not None
    assert path.is_relative_to(tmp_path / "home" / ".local" / "state" / "pomona")
