"""`pomona migrate`: the words of the table change, nothing else; a choice is listed; nothing is lost."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.values import removed
from pomona.executive.values.removed import Removal
from pomona.tools.editor import old_names

ROWS = (
    Removal("skill", ["Look"], "one word for one thing", ["Detect"]),
    Removal("skill", ["Shake"], "no tree needs it"),
    Removal("port", ["MoveTo.slowly"], "write `speed: 20 %` beside the node"),
    Removal("node", ["pipeline"], "its meanings have two words", ["reactive_sequence", "sequence"]),
    Removal("driver", ["sim-robot"], "an arm is an arm", ["sim-arm"]),
    Removal("driver", ["wall"], "no simulated wall is left"),
    Removal("cell", ["wall"], "no simulated wall is left"),
    Removal("tree", ["pick_wall"], "no simulated wall is left"),
    Removal("module", ["pomona.applications.plc"], "it is a device", ["pomona.devices.*"]),
    Removal("module", ["pomona.applications.wall"], "no simulated wall is left"),
    Removal("extra", ["wall"], "no simulated wall is left"),
    Removal("group", ["pomona.walls"], "no simulated wall is left"),
)

TREE = """\
# A tree of the version before; this line stays.
pomona: 1
tree: t      # its name

root:
  sequence:                       # everything
    - Look:   {fruit: apple, detection: "{d}"}   # a look
      timeout: 5 s                # for long
    - "Look": {fruit: lemon, detection: "{e}"}
    - pipeline:
        - Shake: {grasp: "{d}"}   # gone
        - MoveTo: {pose: home, slowly: true}
    - Lift: {keep: 1 s}
    - Lift: {keep: 1 s, hold_time: 2 s}

"""
CHANGED = (
    TREE.replace("- Look:   {", "- Detect:   {")
    .replace('"Look"', '"Detect"')
    .replace("Lift: {keep: 1 s}", "Lift: {hold_time: 1 s}")
)
LEFT = ["10:7 pipeline", "11:11 Shake", "12:30 slowly", "14:14 keep"]


FOLDER = Path(__file__).with_name("before_0_2")
OLD: list[tuple[str, dict[str, str], list[str]]] = [
    (
        "pick_and_place.yaml",  # of 2026-11-22
        {
            "again: never": "reselect: never",
            "times:": "max_selections:",
            "NO_WAY_DOWN": "LOWERING_BLOCKED",
            "NO_WAY_BACK": "RETREAT_BLOCKED",
        },
        [],
    ),
    (
        "pick_apple.yaml",  # of 2026-11-22; the code in a text of two lines has no place of its own
        {
            "then:": "force_after:",
            "keep:": "hold_time:",
            'NO_WAY_UP]"   # these': 'LIFT_BLOCKED]"   # these',
            "unsure:": "fallback_score:",
        },
        ["47:49 mu", "47:61 mu_uncertainty", "47:97 delta", "47:115 gamma", '59:13 "'],
    ),
    (
        "navigate.yaml",  # imported from a tree of Nav2
        {},
        ["4:3 recovery", "5:7 pipeline_sequence", "10:7 round_robin", "14:3 attempts"],
    ),
    (
        "pick_tree.yaml",  # the apples of a wall; it keeps what remains
        {},
        [
            *(
                "19:74 shadow",
                "19:89 foliage",
                "31:90 start_free",
                "56:116 fast",
                "56:187 start_free",
            ),
            *("56:205 raise_again", "62:116 fast", "62:131 slow_within", "62:208 start_free"),
            *("62:226 raise_again", "90:127 shadow", "90:142 foliage", "90:156 target_margin"),
            *("92:15 SampleHanging", "115:11 Detach"),
        ],
    ),
    (
        "measure_fruit.yaml",
        {},
        ["15:7 FirstFrame", "27:23 Tabulate", "33:11 CountFruit", "34:11 NextFrame"],
    ),
    ("pick_tree_cases.yaml", {}, ["3:7 ../experimental/pick_tree.yaml"]),
    ("orchard.yaml", {}, ["21:3 success", "65:11 fruit-wall"]),
    (
        "orchard_ur5e.yaml",  # without the cell that it includes
        {},
        ["2:10 orchard.yaml", "6:12 orchard.yaml#options", "11:12 orchard.yaml#world"],
    ),
    (
        "signals.py.txt",
        {
            f"pomona.applications.signals.{name}": "pomona.devices.plc.skills"
            for name in ("handshake", "set_signal", "wait_signal")
        },
        ["5:6 pomona.applications.signals", "5:41 signal_skill"],
    ),
    (
        "pyproject.toml.txt",
        {
            f"pomona.applications.signals.{name}": "pomona.devices.plc.skills"
            for name in ("set_signal", "wait_signal")
        },
        ["15:24 rerun"],
    ),
]


@pytest.fixture(autouse=True)
def rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for module in (removed, old_names):
        monkeypatch.setattr(module, "removals", lambda: ROWS)
    monkeypatch.chdir(tmp_path)


def written(name: str, text: str | bytes) -> Path:
    path = Path(name)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_a_tree_gets_the_new_words_and_the_rest_stays_byte_for_byte(
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written("t.yaml", TREE)
    assert main(["migrate", "t.yaml"]) == 1
    assert path.read_text() == CHANGED
    out = capsys.readouterr().out
    reason = "(the skill 'Look' became 'Detect' in 0.2: one word for one thing)"
    assert f"t.yaml:7:7: Look → Detect {reason}\n" in out
    assert "t.yaml:13:14: keep → hold_time (Lift has no port 'keep')\n" in out
    assert "the node 'pipeline' became 'reactive_sequence' or 'sequence' in 0.2" in out
    assert "the skill 'Shake' was removed in 0.2: no tree needs it\n" in out
    assert "keep 1 s, or 2 s of 'hold_time' in line 14" in out
    assert "end counts as one" in out
    assert out.endswith("4 errors and 2 warnings.\n")


def test_a_second_time_changes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    path = written("t.yaml", TREE)
    main(["migrate", "t.yaml"])
    first = capsys.readouterr().out.partition("t.yaml:10:7")[1:]
    before = path.stat().st_mtime_ns
    assert main(["migrate", "t.yaml"]) == 1
    assert path.stat().st_mtime_ns == before
    assert capsys.readouterr().out == "".join(first)


def test_check_shows_the_changes_and_writes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    path = written("t.yaml", TREE)
    path.chmod(0o444)
    assert main(["migrate", "--check", "t.yaml"]) == 1
    assert path.read_text() == TREE
    out = capsys.readouterr().out
    assert out.count(" → ") == 3
    assert "end counts as one" in out
    assert out.endswith("4 errors and 2 warnings.\n")


def test_a_file_of_this_version_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    text = "pomona: 1\ntree: t\nroot: {wait: 1 s}\n"
    path = written("t.yaml", text)
    assert main(["migrate", "t.yaml"]) == 0
    assert path.read_text() == text
    assert capsys.readouterr().out == "nothing else is left to change\n"


def test_a_word_with_two_new_ones_is_listed_and_stays(capsys: pytest.CaptureFixture[str]) -> None:
    tree = "pomona: 1\ntree: t\nroot: {pipeline: [{wait: 1 s}]}\n"
    path = written("t.yaml", tree)
    assert main(["migrate", "t.yaml"]) == 1
    assert path.read_text() == tree
    assert "reactive_sequence" in capsys.readouterr().out


def test_the_check_and_a_run_name_the_new_place(capsys: pytest.CaptureFixture[str]) -> None:
    written("t.yaml", TREE)
    for command in (["check", "t.yaml"], ["run", "t.yaml", "--no-record", "--dry"]):
        assert main(command) == 2
        captured = capsys.readouterr()
        said = " ".join((captured.out + captured.err).split())
        assert "error[removed]: the skill 'Look' became 'Detect' in 0.2" in said
        assert "'pomona migrate t.yaml' writes it" in said
        assert "'pomona migrate t.yaml' asks which" in said


def test_cells_campaigns_and_scenarios_are_read(capsys: pytest.CaptureFixture[str]) -> None:
    cell = "include: wall.yaml   # the wall\nworld: {driver: wall}\ndevices:\n  arm: {driver: sim-robot}\n"
    files = {
        "c.yaml": cell,
        "many.yaml": "campaign: many\ntree: pick_wall\ncell: wall\nseeds: 2\n",
        "s.yaml": "pomona: 1\ntree: pick_wall.yaml\ncases: [{expect: success}]\n",
        "t.yaml": "pomona: 1\ntree: t\nroot: {a: {}}\nsubtrees: {a: {file: pick_wall.yaml}}\n",
    }
    for name, text in files.items():
        written(name, text)
    assert main(["migrate", *files]) == 1
    assert Path("c.yaml").read_text() == cell.replace("sim-robot", "sim-arm")
    out = capsys.readouterr().out
    places = [line.split(": ")[0] for line in out.splitlines() if "error[removed]" in line]
    assert places == [
        *(
            "c.yaml:1:10",
            "c.yaml:2:17",
            "many.yaml:2:7",
            "many.yaml:3:7",
            "s.yaml:2:7",
            "t.yaml:4:22",
        )
    ]


def test_names_of_trees_and_cells_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "trees/pick_wall.yaml"]) == 2
    assert main(["run", "pick_apple", "--cell", "wall"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "the tree 'pick_wall' was removed in 0.2: no simulated wall is left" in said
    assert "the cell 'wall' was removed in 0.2: no simulated wall is left" in said


def test_modules_and_extras_of_a_package(capsys: pytest.CaptureFixture[str]) -> None:
    code = (
        '"""Uses pomona.applications.plc."""\n'
        "from pomona.applications.plc.handshake import Handshake  # stays\n"
        "from pomona.applications import (  # a comment\n    wall,\n    plc,\n)\n"
        "import pomona.applications.plcs, my_pomona.applications.plc\n\x0c\n"
        "name = '\u2028' 'pomona.applications.plc'\n"
    )
    project = (
        "[project.entry-points.'pomona.walls']\n"
        'dependencies = ["pomona[torch, wall]>=0.1", "wall"]\n'
        'H = "pomona.applications.plc.handshake:Handshake"   # x\n'
    )
    written("m.py", code)
    written("pyproject.toml", project)
    assert main(["migrate", "m.py", "pyproject.toml"]) == 1
    old, new = "pomona.applications.plc", "pomona.devices.plc"
    assert Path("m.py").read_text() == code.replace(f"Uses {old}", f"Uses {new}").replace(
        f"from {old}", f"from {new}"
    ).replace(f"'{old}'", f"'{new}'")
    assert Path("pyproject.toml").read_text() == project.replace(old, new)
    out = capsys.readouterr().out
    places = [line.split(": ")[0] for line in out.splitlines() if "error[removed]" in line]
    assert places == ["m.py:4:5", "m.py:5:5", "pyproject.toml:1:24", "pyproject.toml:2:32"]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_line_ends_and_byte_order_marks_stay(end: str, mark: str) -> None:
    text = f"{mark}root: {{sequence: [{{Look: {{}}}}, {{Look: {{}}}}]}} # ü\npomona: 1\ntree: t".replace(
        "\n", end
    )
    path = written("t.yaml", text)
    assert main(["migrate", "t.yaml"]) == 0
    assert path.read_bytes().decode() == text.replace("Look", "Detect")


def test_mode_and_link_stay() -> None:
    path = written("t.yaml", TREE)
    path.chmod(0o750)
    Path("link.yaml").symlink_to("t.yaml")
    main(["migrate", "link.yaml"])
    assert Path("link.yaml").is_symlink()
    assert path.read_text() == CHANGED
    assert path.stat().st_mode & 0o777 == 0o750
    assert sorted(os.listdir()) == ["link.yaml", "t.yaml"]


def test_a_word_that_is_written_in_another_way_is_listed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = 'pomona: 1\ntree: t\nroot: {"L\\x6fok": {}}\n'
    path = written("t.yaml", text)
    assert main(["migrate", "t.yaml"]) == 1
    assert path.read_text() == text
    assert "t.yaml:3:8: error[removed]: the skill 'Look' became 'Detect'" in capsys.readouterr().out


def test_a_called_file_that_is_not_named_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    written("main.yaml", "pomona: 1\ntree: m\nroot: {a: {}}\nsubtrees: {a: {file: other.yaml}}\n")
    other = written("other.yaml", "pomona: 1\ntree: a\nroot: {Look: {}}\n")
    assert main(["migrate", "main.yaml"]) == 1
    assert "'pomona migrate other.yaml' writes it" in capsys.readouterr().out
    assert "Look" in other.read_text()
    assert main(["migrate", "main.yaml", "other.yaml"]) == 0
    assert "Detect" in other.read_text()


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("a.yaml", b"a: &x 1\nb: *x\n", "YAML aliases"),
        ("a.yaml", b"root:\n\tsequence: []\n", "a tab"),
        ("a.yaml", b"tree: [\n", "not YAML"),
        ("a.yaml", b"", "empty"),
        ("a.yaml", b"#" + b"x" * 600_000, "KiB"),
        ("a.yaml", b"root: " + b"{sequence: [" * 200 + b"]}" * 200, "nested"),
        ("a.yaml", b"\x89PNG\x00\xff", "not a text file"),
        ("a.py", b"\x00\xff", "not a text file"),
        ("nothing.py", None, "No such file"),
        (".", None, "directory"),
    ],
)
def test_an_unusable_file_ends_the_command_before_anything_is_written(
    name: str, text: bytes | None, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    good = written("good.yaml", TREE)
    if text is not None:
        written(name, text)
    assert main(["migrate", "good.yaml", name]) == 2
    assert good.read_text() == TREE
    error = capsys.readouterr().err
    assert reason in error
    assert "Traceback" not in error


def test_a_read_only_file_stays(capsys: pytest.CaptureFixture[str]) -> None:
    path = written("t.yaml", TREE)
    path.chmod(0o444)
    assert main(["migrate", "t.yaml"]) == 2
    assert path.read_text() == TREE
    assert "read-only" in capsys.readouterr().err


class TestFilesOfEarlierVersions:
    """Files as they stood in the repository, with the table as it is."""

    @pytest.fixture(autouse=True)
    def rows(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.chdir(tmp_path)

    @pytest.mark.parametrize(("name", "changed", "left"), OLD, ids=[row[0] for row in OLD])
    def test_only_the_words_change_and_the_rest_is_listed(
        self,
        name: str,
        changed: dict[str, str],
        left: list[str],
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        text = (FOLDER / name).read_text("utf-8")
        path = written(name.removesuffix(".txt"), text)
        assert main(["migrate", str(path)]) == (1 if left else 0)
        for old, new in changed.items():
            assert old in text
            text = text.replace(old, new)
        assert path.read_bytes() == text.encode()
        out = capsys.readouterr().out
        found = re.findall(r"^\S+?:(\d+):(\d+): error\[removed\]", out, re.MULTILINE)
        assert [f"{line}:{column}" for line, column in found] == [at.split()[0] for at in left]
        for (line, column), at in zip(found, left, strict=True):
            rest = text.splitlines()[int(line) - 1][int(column) - 1 :]
            assert rest.startswith(at.split()[1])
