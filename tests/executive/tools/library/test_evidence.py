"""Evidence: the largest values of believed records beside their limits; nothing else counts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from recorded_events import started

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import (
    Event,
    NodeChanged,
    OperatorActed,
    Published,
    RunEnded,
    TickOverran,
)
from pomona.executive.views import SeriesView
from pomona.tools.library.evidence import gather, read_hazards

CELL = "name: sim\ndevices:\n  gripper: {force_max: 20 N}\n  fingers: {range: 8 N}\n"
SHIPPED = Path(__file__).parents[4] / "trees" / "hazards" / "picking.yaml"


def run(
    folder: Path,
    force: float,
    *,
    drops: int = 0,
    lifted: bool | None = True,
    has_lifted: bool = True,
    speed: float = 1.0,
    truth: Mapping[str, float] = MappingProxyType({}),
    events: Sequence[Event] = (),
) -> Path:
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    recorder.on_event(
        started(
            cell_text=CELL,
            nodes=({"path": "pick/Lift", "parent": None, "name": "Lift", "type": "Lift"},),
        )
    )
    if has_lifted:
        recorder.on_event(NodeChanged(0.1, 5, "pick/Lift", "SUCCESS", "", 1))
    stamp = np.array([0.0, 0.002, 0.004])
    normal = {
        "finger_1_force_z_N": np.array([1.0, force, np.nan]),
        "finger_2_force_z_N": np.array([-1.0, -force, 1.0]),
    }
    recorder.read(
        0.1, 5, {"fingers": {"stamp_s": stamp, **normal, "finger_1_force_x_N": np.full(3, 99.0)}}
    )
    arm = {
        "stamp_s": np.array([0.0, 0.02, 0.02, 0.04]),
        "q_1_rad": np.array([0.0, 0.02 * speed, 5.0, 5.0]),
    }
    recorder.read(0.1, 5, {"arm": arm})
    recorder.on_event(OperatorActed(0.2, 10, "anna", "pause"))
    for event in events:
        recorder.on_event(event)
    score = {"drops": drops, "collisions": 0, "lifted": lifted, **truth}
    recorder.on_event(RunEnded(1.0, 50, "success", None, 50, 1.0, 1.0, score))
    recorder.close()
    return folder


def table(records: list[Path]) -> dict[str, Any]:
    evidence = gather(records, read_hazards(SHIPPED))
    return {
        hazard.name: measured
        for hazard, measured in zip(evidence.hazards, evidence.measured, strict=True)
    }


def test_the_largest_sample_of_all_runs_stands_beside_the_limit_of_its_cell(tmp_path: Path) -> None:
    found = table([run(tmp_path / "a", 3.0), run(tmp_path / "b", 4.5), run(tmp_path / "c", 2.0)])
    crushed = found["Fruit crushed or finger caught"]
    assert (crushed.value, crushed.limit, crushed.run, crushed.runs, crushed.beyond) == (
        9.0,
        20.0,
        "b",
        3,
        0,
    )
    assert crushed.t == pytest.approx(0.002)
    range_of_fingers = found["Finger sensor at the end of its range"]
    assert (range_of_fingers.value, range_of_fingers.limit) == (4.5, 8.0)
    fast = found["The arm moves faster than its joints may"]
    assert fast.value == pytest.approx(1.0)  # two samples of one stamp are no speed
    assert fast.limit == pytest.approx(3.490658504)


@pytest.mark.parametrize(
    "text", ["a: [", "[" * 5000, "!!python/object:os.system 1", "{a: 1, [1]: 3}", "2020-99-99: 1"]
)
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
        "Finger sensor at the end of its range": 1,
        "The arm moves faster than its joints may": 1,
        "The fruit is dropped": 1,
        "Failed pick reported as a success": 1,
    }


def test_a_success_needs_a_lifted_fruit_or_one_that_was_put_away(tmp_path: Path) -> None:
    name = "Failed pick reported as a success"
    away = table([run(tmp_path / "away", 3.0, lifted=None, truth={"put_away": 5})])[name]
    assert (away.runs, away.beyond) == (1, 0)
    empty = table([run(tmp_path / "empty", 3.0, lifted=None, truth={"put_away": 0})])[name]
    assert (empty.runs, empty.beyond) == (1, 1), "Lift succeeded without a fruit"
    look = table([run(tmp_path / "look", 3.0, lifted=None, has_lifted=False)])[name]
    assert look.runs == 0, "a tree that lifts nothing claims no pick"


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
    assert written["left_out"].keys() == {"damaged", "cut"}
    text = (tmp_path / "out" / "evidence.md").read_text()
    assert "6 N" in text
    assert "Limits of this evidence" in text
    assert written["runs"][0]["sha256"] in text


def test_a_campaign_without_records_is_reported_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "results.jsonl").write_text("{}\n")
    assert main(["evidence", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "no records are in this folder" in said
    assert "campaign … --record" in said


def test_a_passed_limit_stands_first_with_a_mark_and_gives_the_exit_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path / "a", 9.0)
    monkeypatch.chdir(tmp_path)
    assert main(["evidence", str(tmp_path)]) == 1
    first, *others, last = capsys.readouterr().out.splitlines()
    assert (
        first
        == "✗ Finger sensor at the end of its range: limit 8 N, largest 9 N, beyond in 1 run of 1"
    )
    assert not any(line.startswith("✗") for line in others)
    assert last == "1 run: 1 limit passed (exit status 1)"
    assert not (tmp_path / "evidence").exists(), "without --out nothing is written"


def test_a_sensor_at_its_end_is_beyond_its_range(tmp_path: Path) -> None:
    found = table([run(tmp_path / "a", 8.0)])
    assert (
        found["Finger sensor at the end of its range"].value,
        found["Fruit crushed or finger caught"].beyond,
    ) == (
        8.0,
        0,
    )
    assert found["Finger sensor at the end of its range"].beyond == 1


def test_the_truth_counts_where_it_is_larger_than_the_measurement(tmp_path: Path) -> None:
    truth = {"finger_peak_n": 9.03, "grasp_peak_n": 2.5}
    found = table([run(tmp_path / "a", 3.0, truth=truth)])
    finger = found["Finger sensor at the end of its range"]
    assert (finger.value, finger.quantity, finger.beyond) == (9.03, "truth: finger_peak_n", 1)
    assert found["Fruit crushed or finger caught"].value == 6.0


@pytest.mark.parametrize(
    ("truth", "beyond", "value"), [({}, 0, 12.0), ({"grasp_peak_n": 15.3}, 1, 15.3)]
)
def test_the_grip_is_held_against_the_limit_that_is_recorded_with_it(
    tmp_path: Path, truth: dict[str, float], beyond: int, value: float
) -> None:
    t = np.array([0.5, 0.6])
    thresholds = {"force limit [N]": 14.0}
    grip = SeriesView(t, {"grasp force [N]": np.array([3.0, 12.0]), "width [m]": t}, thresholds)
    found = table(
        [run(tmp_path / "a", 3.0, truth=truth, events=(Published(0.6, 30, "Grip", "grip", grip),))]
    )
    held = found["Grip harder than its force limit"]
    assert (held.value, held.limit, held.beyond) == (value, 14.0, beyond)


@pytest.mark.parametrize(
    "text", ["", "7", "hazards: 3", "hazards: [{hazard: x}]", "hazards: [[", "\x00"]
)
def test_a_file_that_lists_no_hazards_is_refused_in_words(tmp_path: Path, text: str) -> None:
    (tmp_path / "h.yaml").write_text(text)
    with pytest.raises(UsageError, match="not a file of hazards"):
        read_hazards(tmp_path / "h.yaml")


@pytest.mark.parametrize(("kind", "runs"), [("simulated", 0), ("real", 1)])
def test_a_late_tick_is_no_hazard_where_the_world_stands_still(
    tmp_path: Path, kind: str, runs: int
) -> None:
    recorder = Recorder(tmp_path)
    recorder.on_event(started(cell_text=CELL, cell_kind=kind))
    recorder.on_event(TickOverran(0.2, 10, "a", 3.0, 0.1))
    recorder.on_event(RunEnded(1.0, 50, "success", None, 50, 1.0, 1.0, None))
    recorder.close()
    late = table([tmp_path])["Devices unmonitored during a late tick"]
    assert (late.runs, late.beyond) == (runs, runs)
