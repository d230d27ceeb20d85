"""`pomona calibrate from-picks` and the sentence of `pomona explain`, on recorded runs."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.realsense.mounted_camera import read_hand_eye
from pomona.executive.cli import main
from pomona.executive.recording.folder import events_file
from pomona.tools.caliper.explain import explain
from pomona.tools.caliper.records import Picks, values_of
from tests.skills.tools.caliper.recorded_runs import CELL, picks_of, runs_of, write_run
from tests.skills.tools.caliper.synthetic import doubted, recorded


def call(*words: object) -> int:
    return main(["calibrate", "from-picks", *map(str, words)])


def test_the_proposal_puts_the_camera_where_the_fingers_felt_the_fruit(tmp_path, capsys):
    out = tmp_path / "calibration.yaml"
    assert call(runs_of(tmp_path / "runs", 6e-3), "--out", out) == 0
    told = capsys.readouterr().out
    assert "mm to the right of where the cell file has it" in told
    assert "4 picks kept apart: first touch off by" in told
    assert "not known: place along the view" in told
    assert "; grasps tilted by 30° and more" in told
    assert (
        "known: place across the picture ± 0." in told
        or "known: place along the picture's height ± 0." in told
    )
    content = json.loads(out.read_text())
    assert content["kept_apart"]["after_mm"] < 0.3 * content["kept_apart"]["before_mm"]
    T = read_hand_eye(out)
    at = T[:3, :3] @ np.array([0.0, 0.0, 0.5]) + T[:3, 3]
    assert at[0] == pytest.approx(6e-3, abs=1e-3)


def test_doubted_looks_alone_propose_height_and_tilts(tmp_path, capsys):
    error = np.array([0.0, 0.0, 12e-3, *np.radians([2.5, 0.0, 0.0]), 0.0, 0.0])
    for i in range(6):
        write_run(
            tmp_path / "runs" / f"2026-01-01_10-00-{i:02d}_pick",
            doubted(error + 1e-7 * i),
            topic="doubted_look",
        )
    out = tmp_path / "calibration.yaml"
    assert call(tmp_path / "runs", "--out", out) == 0
    told = capsys.readouterr().out
    assert "is turned by 2.5 ± 0." in told
    assert "(6 looks)" in told
    assert "2 picks kept apart: table off by" in told
    T = read_hand_eye(out)
    assert np.degrees(np.arcsin(T[2, 1])) == pytest.approx(2.5, abs=0.1)


def test_copies_of_a_record_count_once(tmp_path, capsys):
    runs_of(tmp_path / "runs", 6e-3, count=5)
    for k in range(3):
        shutil.copytree(
            tmp_path / "runs" / "2026-01-01_10-00-00_pick", tmp_path / "runs" / f"copy_{k}"
        )
    assert call(tmp_path / "runs", "--out", tmp_path / "calibration.yaml") == 2
    told = capsys.readouterr().err
    assert "usable picks: 5, in runs: 8; needed are 6 picks" in told
    assert told.count("a copy of its record") == 3


def test_a_second_touch_of_the_same_look_is_refused_since_the_first_has_moved_the_fruit():
    first, again, other = recorded(3e-3), recorded(6e-3), recorded(2e-3, x=0.05)
    read = Picks.of_run("run", "sim", "", [("a", first), ("b", again), ("c", other)])
    assert [pick.name for pick in read.picks] == ["a", "c"]
    assert read.refused == ["b: an earlier touch has moved the fruit since its look"]


def test_a_camera_in_its_place_is_left_there_or_corrected_by_less_than_the_noise(tmp_path, capsys):
    out = tmp_path / "calibration.yaml"
    code = call(runs_of(tmp_path / "runs", 0.0), "--out", out)
    told = "".join(capsys.readouterr())
    assert "The camera is at most 0." in told
    assert "along other lines its place is not known" in " ".join(told.split())
    assert code == 2 or abs(json.loads(out.read_text())["error"][0]) < 3e-3


def test_older_runs_of_another_calibration_are_left_out_and_named(tmp_path, capsys):
    runs = runs_of(tmp_path / "runs", 6e-3, 10)
    for i, touches in enumerate(picks_of(4e-3, 7, seed=5)):
        touches["T_mount_camera"][0][3] = 0.01
        write_run(runs / f"2026-01-02_10-00-{i:02d}_pick", touches)
    assert call(runs, "--out", tmp_path / "c.yaml") == 0
    told = capsys.readouterr().out
    assert "not used: 2026-01-01_10-00-09_pick" in told
    assert "(7 picks)" in told


def test_a_camera_that_was_knocked_between_the_picks_gets_no_proposal(tmp_path, capsys):
    runs = runs_of(tmp_path / "runs", 0.0, 8)
    for i, touches in enumerate(picks_of(8e-3, 8, seed=5)):
        write_run(runs / f"2026-01-02_10-00-{i:02d}_pick", touches)
    assert call(runs, "--out", tmp_path / "c.yaml") == 2
    assert "It has moved since: name the runs after that" in capsys.readouterr().err


@pytest.mark.parametrize("other", ["cell", "calibration"])
def test_runs_of_another_cell_or_calibration_are_refused(tmp_path, capsys, other):
    runs = runs_of(tmp_path / "runs", 6e-3, 6)
    touches, cell = recorded(), CELL
    if other == "cell":
        cell = "name: sim\nworkspace: {}\n"
    else:
        touches["T_mount_camera"][0][3] = 0.01
    write_run(runs / "2026-01-01_11-00-00_pick", touches, cell=cell)
    assert call(runs, "--out", tmp_path / "c.yaml") == 2
    told = capsys.readouterr().err
    assert f"name runs of one {other}" in told
    assert "2026-01-01_11-00-00_pick" in told
    assert not (tmp_path / "c.yaml").exists()


def test_too_few_picks_are_refused_and_unusable_touches_named(tmp_path, capsys):
    run = write_run(
        tmp_path / "run", *picks_of(6e-3, 4), recorded(wider=-0.06), recorded(wider=0.03)
    )
    assert call(run, "--out", tmp_path / "c.yaml") == 2
    told = capsys.readouterr().err
    assert "usable picks: 4, in runs: 1; needed are 6 picks" in told
    assert "touched each other" in told
    assert "another fruit" in told


def test_a_folder_without_records_and_a_file_that_is_there_are_refused(tmp_path, capsys):
    assert call(tmp_path, "--out", tmp_path / "c.yaml") == 2
    assert "no records in" in capsys.readouterr().err
    (tmp_path / "c.yaml").write_text("earlier")
    assert call(tmp_path, "--out", tmp_path / "c.yaml") == 2
    assert "nothing is overwritten" in capsys.readouterr().err
    assert (tmp_path / "c.yaml").read_text() == "earlier"


def test_a_run_that_holds_no_pick_is_named_beside_those_that_are_used(tmp_path, capsys):
    runs = runs_of(tmp_path / "runs", 6e-3)
    write_run(runs / "2026-01-01_11-00-00_pick")
    assert call(runs, "--out", tmp_path / "c.yaml") == 0
    assert "not used: 2026-01-01_11-00-00_pick: it holds no touch" in capsys.readouterr().out


def test_a_record_that_was_cut_at_its_beginning_is_named(tmp_path, capsys):
    runs = runs_of(tmp_path / "runs", 6e-3)
    events_file(max(runs.iterdir())).write_bytes(b"")
    assert call(runs, "--out", tmp_path / "c.yaml") == 0
    assert (
        f"not used: {max(runs.iterdir())}: the record holds no beginning of a run"
        in capsys.readouterr().out
    )
    assert explain(max(runs.iterdir())) == ""


def test_explain_reports_the_camera_from_this_run_and_those_before_it(tmp_path, capsys):
    runs = runs_of(tmp_path / "runs", -6e-3, 6)
    newest = max(runs.iterdir())
    assert "mm to the left of where" in explain(newest)
    assert "(6 picks)" in explain(newest)
    assert "Width of the fruit between the fingers: 80." in explain(newest)
    assert explain(newest).count("camera alone: 80.0") == 1
    write_run(runs / "2026-01-01_09-00-00_pick", recorded(), cell="name: other\n")
    assert "(6 picks)" in explain(newest)
    assert main(["explain", newest.name, "--record", str(runs)]) == 0
    assert "(6 picks)" in " ".join(capsys.readouterr().out.split())


def test_explain_says_why_no_pick_can_be_used(tmp_path):
    no_width = {"type": "PadTouch", "stamp": 1.0, "width": None, "force": 0.5}
    unknown = write_run(
        tmp_path / "run", recorded() | {"left": None, "right": None, "closed": no_width}
    )
    assert explain(unknown).startswith("No word about the camera: ")
    assert explain(write_run(tmp_path / "other" / "run")) == ""


def test_the_widths_of_a_run_with_many_picks_fit_one_sentence(tmp_path):
    few, many = (
        write_run(tmp_path / name / "run", *picks_of(0.0, count))
        for name, count in (("3", 3), ("9", 9))
    )
    assert "Widths of 3 fruit between the fingers: 80." in explain(few)
    assert "(camera alone: 80.0, 80.0, 80.0)." in explain(few)
    assert "Widths of 9 fruit between the fingers: 80." in explain(many)
    assert "(camera alone: 0.0 mm beside, median)." in explain(many)


def test_a_run_without_touches_gets_no_sentence(tmp_path):
    assert explain(write_run(tmp_path / "run")) == ""


def test_a_sentence_that_cannot_be_added_does_not_stop_the_explanation(
    tmp_path, capsys, monkeypatch
):
    def broken(_record: Path) -> str:
        raise ValueError("no word")

    monkeypatch.setattr("pomona.tools.caliper.explain.explain", broken)
    run = write_run(tmp_path / "run", recorded())
    assert main(["explain", str(run)]) == 0
    assert "TouchesView: nothing can be added: no word" in " ".join(capsys.readouterr().out.split())


def test_only_other_values_of_a_cells_files_make_another_calibration():
    cell = "name: sim\ndevices:\n  camera: {driver: sim-camera}\n  caliper: {driver: caliper}\n"
    same = cell.replace("driver: caliper}", "driver: caliper, warn: 3 mm}") + "# a note\n"
    assert values_of(cell) == values_of(same)
    assert values_of(cell) != values_of(cell.replace("sim-camera", "realsense"))
    assert values_of("a: [") != values_of("a: [b")
