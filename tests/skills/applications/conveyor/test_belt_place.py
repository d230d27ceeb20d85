"""Checks of a belt's place in its cell: height, workspace, obstacles, the watch's volume, a second belt, cameras."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive import find_cell
from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Findings

SHIPPED = find_cell("conveyor")
TEXT = SHIPPED.read_text("utf-8").replace("../", f"{SHIPPED.parent.parent}/")
VOLUME = "lower: -0.95 -0.48 -0.14 m, upper: 0.95 -0.24 -0.02 m"
BELOW = "  conveyor:\n    driver: sim-conveyor\n"
PERSON = "  intruder: {start: 1 0 0 m, goal: 0 0 0.3 m}\n  fruits:"
FIXED = "  above:\n    driver: sim-camera\n    fixed: {position: 0 -0.36 1.3 m, looks_at: AT}\n    intrinsics: LENS\n"
LENS = "{fx: 610.6 px, fy: 610.6 px, cx: 317.7 px, cy: 238.1 px, width: 640, height: 480}"
SIGNALS = f"""\
name: line
kind: real
workspace: {{include: {SHIPPED}#workspace}}
devices:
  plc:
    driver: modbus-signals
    address: 127.0.0.1:50502
    heartbeat: {{output: coil 0, input: discrete 0}}
    inputs:
      start: {{at: discrete 1}}
      travel: {{at: input 10, type: int32, scale: 0.0001}}
    outputs:
      runs: {{at: coil 1}}
  conveyor:
    driver: signal-conveyor
    beside: -360 mm
    top: -120 mm
    travel: travel
    runs: runs
"""


def judged(folder: Path, text: str, alone: bool = False) -> list[tuple[str, str, str]]:
    """Return severity, written line and message of each finding of a cell file.

    That of its one camera, which sees no person, only if `alone`.
    """
    path, findings = folder / "cell.yaml", Findings()
    path.write_text(text, "utf-8")
    judge_cell_file(path, findings)
    lines = text.split("\n")
    return [
        (each.severity, lines[each.line - 1].strip(), f"{each.message}; {each.hint}")
        for each in findings.sorted()
        if alone or "no fixed camera" not in each.message
    ]


def edited(old: str, new: str, text: str = TEXT) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_the_shipped_belt_and_one_behind_a_plc_have_no_findings(tmp_path: Path) -> None:
    assert judged(tmp_path, TEXT) == []
    assert judged(tmp_path, SIGNALS) == []


@pytest.mark.parametrize("text", [TEXT, SIGNALS], ids=["simulated", "signals"])
@pytest.mark.parametrize("top", ["400 mm", "-60 mm"])
def test_a_belt_at_another_height_than_the_table_is_an_error_with_both_heights(
    tmp_path: Path, text: str, top: str
) -> None:
    ((severity, line, words),) = judged(tmp_path, edited("top: -120 mm", f"top: {top}", text))
    assert (severity, line) == ("error", f"top: {top}")
    assert f"the belt lies at {top}" in words
    assert "workspace.table_z, by which paths are planned, at -120 mm" in words


@pytest.mark.parametrize("text", [TEXT, SIGNALS], ids=["simulated", "signals"])
@pytest.mark.parametrize(
    ("beside", "sides"),
    [("-1.5 m", "-1620 to -1380 mm"), ("360 mm", "240 to 480 mm"), ("-700 mm", "-820 to -580 mm")],
)
def test_a_belt_outside_the_workspace_is_an_error(
    tmp_path: Path, text: str, beside: str, sides: str
) -> None:
    ((severity, line, words),) = judged(
        tmp_path, edited("beside: -360 mm", f"beside: {beside}", text)
    )
    assert (severity, line) == ("error", f"beside: {beside}")
    assert (
        f"the belt, y {sides} and z -120 mm, leaves the workspace, y -800 to 300 mm, z -140 to 700 mm"
        in words
    )


def test_a_workspace_that_ends_before_the_belt_is_an_error(tmp_path: Path) -> None:
    found = judged(tmp_path, edited("lower: -0.90 -0.80 -0.14 m", "lower: -0.90 -0.20 -0.14 m"))
    assert [(severity, line) for severity, line, _ in found] == [("error", "beside: -360 mm")]
    assert "y -200 to 300 mm" in found[0][2]


def test_a_belt_through_an_obstacle_is_an_error_with_its_name_and_one_below_or_beside_it_is_none(
    tmp_path: Path,
) -> None:
    found = judged(tmp_path, edited("beside: -360 mm", "beside: -210 mm"))
    assert [line for _, line, _ in found] == ["beside: -210 mm"] * 2
    assert "crate_small" in found[0][2]
    assert "crate_large" in found[1][2]
    for centre in ("0 -0.36 -0.17 m", "0.5 -0.53 -0.1 m", "0.5 -0.36 0.10 m"):
        box = f"    obstacles:\n    - {{name: box, centre: {centre}, size: 0.1 0.1 0.1 m}}".removeprefix(
            "  "
        )
        assert judged(tmp_path, edited("  obstacles:", box)) == []


@pytest.mark.parametrize(
    "volume",
    [
        "lower: -950 -480 -140 m, upper: 950 -240 -20 m",
        "lower: -0.95 0.24 -0.14 m, upper: 0.95 0.48 -0.02 m",
    ],
    ids=["millimetres", "sign"],
)
def test_a_watch_whose_volume_does_not_hold_the_belt_is_an_error_at_passing(
    tmp_path: Path, volume: str
) -> None:
    ((severity, line, words),) = judged(tmp_path, edited(VOLUME, volume))
    assert (severity, line) == ("error", f"- {{name: belt, {volume}}}")
    assert words.startswith(
        "workspace.watch.passing: no volume `passing` holds the fruit on the belt"
    )
    remedy = words.partition("; - {name: belt, ")[2].removesuffix("}")
    assert judged(tmp_path, edited(VOLUME, remedy)) == []


def test_a_watch_without_a_volume_for_the_belt_is_an_error(tmp_path: Path) -> None:
    text = edited(f"    passing:\n      - {{name: belt, {VOLUME}}}\n", "    speed: 1.6 m/s\n")
    ((severity, line, words),) = judged(tmp_path, text)
    assert (severity, line) == ("error", "speed: 1.6 m/s")
    assert words.startswith("workspace.watch: no volume `passing`")


def test_a_volume_that_is_far_higher_than_fruit_is_warned_of(tmp_path: Path) -> None:
    found = judged(tmp_path, edited("0.95 -0.24 -0.02 m", "0.95 -0.24 0.60 m"))
    assert [severity for severity, _, _ in found] == ["warning"]
    assert (
        "workspace.watch.passing: up to 720 mm over the belt the watch sees no person"
        in found[0][2]
    )
    assert judged(tmp_path, edited("0.95 -0.24 -0.02 m", "0.95 -0.24 0.03 m")) == []


@pytest.mark.parametrize(
    ("text", "first", "second"),
    [
        (TEXT, BELOW, "  conveyor_2:\n    driver: sim-conveyor\n"),
        (
            SIGNALS,
            SIGNALS[SIGNALS.index("  conveyor:") :],
            SIGNALS[SIGNALS.index("  conveyor:") :].replace(":", "_2:", 1),
        ),
    ],
    ids=["simulated", "signals"],
)
def test_a_second_belt_is_an_error(tmp_path: Path, text: str, first: str, second: str) -> None:
    ((severity, line, words),) = judged(tmp_path, edited(first, first + second, text))
    assert severity == "error"
    assert line.startswith("driver: ")
    assert (
        "devices.conveyor_2.driver: the cell has the belt 'conveyor' already; leave one of them"
        in words
    )


@pytest.mark.parametrize(
    ("at", "warned"), [("0 -0.36 -0.12 m", False), ("0 -0.36 3 m", True), ("2 -0.36 1.2 m", True)]
)
def test_a_fixed_camera_counts_if_it_sees_the_belt(tmp_path: Path, at: str, warned: bool) -> None:
    camera = FIXED.replace("AT", at).replace("LENS", LENS)
    for text in (edited("  fruits:", PERSON), TEXT):
        found = judged(tmp_path, text + camera, alone=True)
        assert [severity for severity, _, _ in found] == ["warning"] * warned
        assert all("'above' looks past the belt" in words for _, _, words in found)


def test_a_cell_says_always_that_it_sees_no_person_beside_the_arm(tmp_path: Path) -> None:
    robot = f"{SHIPPED.parent.parent}/robots/sia5f_wsg32.xml"
    camera = f"  camera:\n    driver: emulated-camera\n    address: 127.0.0.1:50001\n    robot: {robot}\n"
    arm = f"  arm: {{driver: motoman, address: 127.0.0.1:1, controller: fs100, robot: {robot}, joints: S L E U R B T}}\n"
    for text in (TEXT, SIGNALS + arm + camera, SIGNALS + camera + arm):
        ((severity, _, words),) = judged(tmp_path, text, alone=True)
        assert severity == "note"
        assert words.startswith("no fixed camera watches the paths")
    assert judged(tmp_path, SIGNALS, alone=True) == []  # a cell without an arm


@pytest.mark.parametrize(
    ("old", "new", "at", "words"),
    [
        (
            " travel: travel\n",
            " travel: travell\n",
            "travel: travell",
            "no input 'travell' that is a number; did you mean",
        ),
        (
            " travel: travel\n",
            " travel: start\n",
            "travel: start",
            "no input 'start' that is a number",
        ),
        (
            " runs: runs\n",
            " runs: run\n",
            "runs: run",
            "no output 'run' that is a switch; did you mean 'runs'",
        ),
        (" runs: runs\n", " runs: start\n", "runs: start", "no output 'start' that is a switch"),
        (
            "int32, scale: 0.0001",
            "int16, scale: 0.0001",
            "travel: travel",
            "begins anew after 6.55 m",
        ),
        ("int32, scale: 0.0001", "int32", "travel: travel", "one count of 'travel' is 1000 mm"),
    ],
    ids=["typing", "switch", "output", "input", "short", "unscaled"],
)
def test_signals_are_checked_with_the_cell(
    tmp_path: Path, old: str, new: str, at: str, words: str
) -> None:
    ((severity, line, message),) = judged(tmp_path, edited(old, new, SIGNALS))
    assert (severity, line) == ("error", at)
    assert words in message


def test_a_float_needs_no_scale(tmp_path: Path) -> None:
    assert judged(tmp_path, edited("int32, scale: 0.0001", "float32", SIGNALS)) == []
