"""Evidence: the largest values of believed records beside their limits; nothing else counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_events import started

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording.evidence import gather, read_hazards
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import OperatorActed, RunEnded

CELL = "name: sim\ndevices:\n  gripper: {force_max: 20 N}\n  fingers: {range: 8 N}\n"
SHIPPED = Path(__file__).parents[3] / "trees" / "hazards" / "picking.yaml"


def run(folder: Path, force: float, *, drops: int = 0, lifted: bool = True, speed: float = 1.0) -> Path:
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    recorder.on_event(started(cell_text=CELL))
    stamp = np.array([0.0, 0.002, 0.004])
    normal = {"finger_1_force_z_N": np.array([1.0, force, np.nan]), "finger_2_force_z_N": np.array([-1.0, -force, 1.0])}
    recorder.read(0.1, 5, {"fingers": {"stamp_s": stamp, **normal, "finger_1_force_x_N": np.full(3, 99.0)}})
    arm = {"stamp_s": np.array([0.0, 0.02, 0.02, 0.04]), "q_1_rad": np.array([0.0, 0.02 * speed, 5.0, 5.0])}
    recorder.read(0.1, 5, {"arm": arm})
    recorder.on_event(OperatorActed(0.2, 10, "anna", "pause"))
    recorder.on_event(
        RunEnded(1.0, 50, "success", None, 50, 1.0, 1.0, {"drops": drops, "collisions": 0, "lifted": lifted})
    )
    recorder.close()
    return folder


def table(records: list[Path]) -> dict[str, Any]:
    evidence = gather(records, read_hazards(SHIPPED))
    return {hazard.name: measured for hazard, measured in zip(evidence.hazards, evidence.measured, strict=True)}


def test_the_largest_sample_of_all_runs_stands_beside_the_limit_of_its_cell(tmp_path: Path) -> None:
    found = table([run(tmp_path / "a", 3.0), run(tmp_path / "b", 4.5), run(tmp_path / "c", 2.0)])
    crushed = found["The fruit is crushed, a finger is caught"]
    assert (crushed.value, crushed.limit, crushed.run, crushed.runs, crushed.beyond) == (9.0, 20.0, "b", 3, 0)
    assert crushed.t == pytest.approx(0.002)
    range_of_fingers = found["A finger sensor is driven beyond what it can measure"]
    assert (range_of_fingers.value, range_of_fingers.limit) == (4.5, 8.0)
    fast = found["The arm moves faster than its joints may"]
    assert fast.value == pytest.approx(1.0)  # two samples of one stamp are no speed
    assert fast.limit == pytest.approx(3.490658504)


@pytest.mark.parametrize("text", ["a: [", "[" * 5000, "!!python/object:os.system 1", "{a: 1, [1]: 3}", "2020-99-99: 1"])
def test_a_record_whose_cell_cannot_be_read_is_no_evidence(tmp_path: Path, text: str) -> None:
    recorder = Recorder(tmp_path)
    recorder.on_event(started(cell_text=text))
    recorder.on_event(RunEnded(1.0, 50, "success", None, 50, 1.0, 1.0, None))
    recorder.close()
    left_out = gather([tmp_path], read_hazards(SHIPPED)).left_out
    assert list(left_out) == [tmp_path.name]
    assert "it cannot be measured" in left_out[tmp_path.name]


def test_a_limit_that_was_passed_is_counted(tmp_path: Path) -> None:
    lied = run(tmp_path / "lied", 9.0, drops=1, lifted=False, speed=4.0)
    found = table([lied, run(tmp_path / "good", 3.0)])
    assert {name: measured.beyond for name, measured in found.items() if measured.beyond} == {
        "A finger sensor is driven beyond what it can measure": 1,
        "The arm moves faster than its joints may": 1,
        "The fruit is dropped": 1,
        "A success is told that is none": 1,
    }


def test_a_record_that_cannot_be_believed_is_no_evidence_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "records"
    path = run(runs / "damaged", 30.0) / EVENTS_FILE
    path.write_bytes(path.read_bytes().replace(b'"outcome":"success"', b'"outcome":"failure"'))
    cut = run(runs / "cut", 30.0) / EVENTS_FILE
    cut.write_bytes(cut.read_bytes()[:500])
    assert main(["evidence", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "no record can serve as evidence" in capsys.readouterr().err
    run(runs / "good", 3.0)
    assert main(["evidence", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    written = json.loads((tmp_path / "out" / "evidence.json").read_text())
    assert [entry["run"] for entry in written["runs"]] == ["good"]
    assert written["runs"][0]["interventions"] == 1
    assert len(written["runs"][0]["interventions_digest"]) == 64
    assert written["left_out"].keys() == {"damaged", "cut"}
    text = (tmp_path / "out" / "evidence.md").read_text()
    assert "6 N" in text
    assert "What this does not claim" in text
    assert written["runs"][0]["sha256"] in text


def test_a_campaign_that_kept_no_records_is_said_to_have_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "results.jsonl").write_text("{}\n")
    assert main(["evidence", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "no records are in this folder" in said
    assert "campaign … --record" in said


def test_a_passed_limit_is_told_by_the_exit_status(tmp_path: Path) -> None:
    run(tmp_path / "a", 9.0)
    assert main(["evidence", str(tmp_path), "--out", str(tmp_path / "out")]) == 1


@pytest.mark.parametrize("text", ["", "7", "hazards: 3", "hazards: [{hazard: x}]", "hazards: [[", "\x00"])
def test_a_file_that_lists_no_hazards_is_refused_in_words(tmp_path: Path, text: str) -> None:
    (tmp_path / "h.yaml").write_text(text)
    with pytest.raises(UsageError, match="not a file of hazards"):
        read_hazards(tmp_path / "h.yaml")
