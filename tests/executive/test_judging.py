"""Tree, cell and the requirements of skills are checked together, at their places, without a connection."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pomona.drivers.interfaces import StreamedArm
from pomona.executive.cli import main as pomona
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document
from pomona.executive.ports import Length
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work
from pomona.executive.values.findings import Finding
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.sections import Problem
from pomona.skills.perception.fruit.catalogue import CATALOGUE

TREE = """pomona: 1
tree: look
parameters:
  kind: {type: text, default: apple}
  where: {type: text, default: observe}
root:
  sequence:
    - go: {to: "{where}"}
    - go: {to: home}
    - Detect: {fruit: "{kind}", detection: "{d}"}
    - Refine: {detection: "{d}"}
subtrees:
  go:
    in: {to: text}
    root:
      MoveTo: {pose: "{to}"}
"""


def test_equal_values_are_judged_once(registry, tmp_path, monkeypatch):
    asked, detect = [], registry["Detect"]
    monkeypatch.setattr(
        detect,
        "judge",
        lambda known, cell: asked.append(known["fruit"]) or [Problem("fruit", "no")],
    )
    nodes = "".join(
        f'    - Detect: {{fruit: {fruit}, detection: "{{d}}"}}\n'
        for fruit in ("apple", "lemon", "apple")
    )
    path = tmp_path / "t.yaml"
    path.write_text("pomona: 1\ntree: t\nroot:\n  sequence:\n" + nodes)
    found = judge(read_document(path), registry, {}, find_cell("sim")).findings.sorted()
    assert asked == ["apple", "lemon"]
    assert [finding.line for finding in found if finding.code == "unfit"] == [5, 6, 7]


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.installed()


@pytest.fixture
def unconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(*_arguments: object, **_more: object) -> None:
        raise AssertionError("a device was connected")

    monkeypatch.setattr("pomona.executive.cell.connect.connect_cell", connect)


def judged(
    folder: Path, registry: Registry, text: str = TREE, cell: str | None = "sim", **settings: str
) -> list[Finding]:
    path = folder / "look.yaml"
    path.write_text(text)
    file = find_cell(cell) if cell else None
    found = judge(read_document(path), registry, settings, file).findings.sorted()
    return [each for each in found if each.severity != "note"]


def test_nothing_is_wrong_with_a_sound_tree_on_its_cell(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    assert judged(tmp_path, registry) == []
    assert judged(tmp_path, registry, cell=None) == []


def test_a_pose_that_the_cell_lacks_is_found_where_it_is_written(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    (found,) = judged(tmp_path, registry, TREE.replace("to: home", "to: hoem"))
    assert (found.line, found.severity, found.hint) == (16, "error", "did you mean 'home'?")
    assert "the cell 'sim' has no pose 'hoem'" in found.message
    (found,) = judged(tmp_path, registry, where="nowhere")
    assert "has no pose 'nowhere'" in found.message
    assert judged(tmp_path, registry, cell=None, where="nowhere") == []  # no cell, no poses


def test_mistakes_elsewhere_hide_no_pose(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    wrong = TREE.replace("to: home", "to: hoem").replace("- Refine:", "- Refien:")
    found = judged(tmp_path, registry, wrong + "  other: {root: {wait: 5}}\n")
    assert [f.code for f in found] == ["unknown-skill", "unfit", "value"]
    assert found[1].hint == "did you mean 'home'?"


MOVES = """pomona: 1
tree: moves
root:
  fallback:
    - MoveTo: {pose: home}
    - Policy: {network: net.onnx, x: 0 m, y: 0 m, z: 0 m}
"""


class Policy(Skill):
    """A skill that streams to the arm and watches nothing."""

    devices = (StreamedArm,)

    def run(self, network: str, x: Length, y: Length, z: Length) -> Work[None]:
        yield network


def test_a_skill_that_moves_unwatched_is_named_where_something_may_be_noticed(
    registry: Registry, tmp_path: Path
) -> None:
    with_policy = Registry({**registry, "Policy": Policy})
    [found] = judged(tmp_path, with_policy, MOVES)
    assert (found.line, found.severity) == (6, "warning")
    assert "Policy: moves the StreamedArm unwatched" in found.message
    alone = MOVES.replace("    - MoveTo: {pose: home}\n", "")
    assert judged(tmp_path, with_policy, alone) == []


def test_an_unreadable_value_is_not_judged_as_a_default(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    broken = TREE.replace("{type: text, default: observe}", "{type: txt, default: observe}")
    assert {f.code for f in judged(tmp_path, registry, broken)} == {"unknown-type"}
    endless = TREE + "  again: {root: {again: {}}}\n"
    assert "recursion" in {f.code for f in judged(tmp_path, registry, endless)}


def test_an_unknown_or_missing_fruit_is_found(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    (found,) = judged(tmp_path, registry, cell=None, kind="aple")
    assert (found.line, found.severity) == (10, "error")
    assert "did you mean 'apple'?" in found.message
    (found,) = judged(tmp_path, registry, kind="lemon")
    assert (found.line, found.severity) == (10, "warning")
    assert "no lemon on the table of the cell 'sim', which holds apple" in found.message
    assert judged(tmp_path, registry, kind="lemon", fruit="lemon") == []
    own = shutil.copytree(
        CATALOGUE / "lemon", tmp_path / "apple"
    )  # the table knows the folder of its fruit
    assert judged(tmp_path, registry, kind=str(own)) == []


def test_fruit_without_weights_is_reported_with_the_command_that_makes_them(
    tmp_path: Path, registry: Registry
) -> None:
    assert pomona(["new", "fruit", "plum", "--into", str(tmp_path)]) == 0
    path = tmp_path / "plum" / "fruit.yaml"
    (found, *_) = judged(tmp_path, registry, cell=None, kind=str(path))
    assert found.message == "Detect: there are no weights to find plum by"
    command = f"pomona train detect --fruit {path} --out plum.weights"
    assert (
        found.hint
        == f"train its detector: {command}, then wire 'weights: plum.weights' beside 'fruit'"
    )


def test_fruit_with_a_broken_file_or_broken_weights_is_found_before_the_run(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    fruit = tmp_path / "plum"
    fruit.mkdir()
    (fruit / "plum.ply").write_text("no mesh")
    about = "name: plum\nmesh: plum.ply\ndimensions: 50 50 50 mm\nsymmetry_axis: [0, -1, 0]\nweights: plum.weights\n"
    (fruit / "fruit.yaml").write_text(about)
    (found,) = judged(tmp_path, registry, cell=None, kind=str(fruit))
    assert "fruit.yaml:2:7" in found.message
    assert "is no mesh that can be read" in found.message


def test_a_setting_that_neither_tree_nor_cell_knows_gets_a_hint_from_both(
    tmp_path: Path, registry: Registry
) -> None:
    (found,) = judged(tmp_path, registry, knid="apple")
    assert (found.path, found.hint) == ("--set knid=apple", "did you mean 'kind'?")
    (found,) = judged(tmp_path, registry, plaec="3")
    assert found.hint == "did you mean 'place'?"


def test_every_mistake_of_tree_cell_and_settings_is_found_in_one_pass(
    tmp_path: Path, registry: Registry, unconnected: None
) -> None:
    found = judged(tmp_path, registry, mass="3 m", friction="-1", kind="aple")
    assert [f.path.removeprefix("--set ").partition("=")[0] for f in found[:2]] == [
        "friction",
        "mass",
    ]
    assert len(found) == 3


def test_a_run_with_a_wrong_value_connects_nothing(tmp_path: Path, unconnected: None) -> None:
    path = tmp_path / "look.yaml"
    path.write_text(TREE)
    with pytest.raises(UsageError, match=r"(?s)--set friction=-1: error.*Nothing was run"):
        execute(RunOrder(path, find_cell("sim"), settings={"friction": "-1"}))
    with pytest.raises(UsageError, match=r"no fruit named 'aple'.*(?s:.*)Nothing was run"):
        execute(RunOrder(path, find_cell("sim"), settings={"kind": "aple"}))


def test_every_installed_cell_is_checked_as_one_and_so_is_a_cell_that_includes_it(
    tmp_path: Path, unconnected: None, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own.yaml"
    for text in (
        "include: sim.yaml\noptions: {tilt: 3}\n",
        "include: sim.yaml\nworld: {include: sim.yaml#world, tilt: 3}\n",
    ):
        own.write_text(text)
        assert pomona(["check", str(own)]) == 2
        assert "'3' lacks a unit" in capsys.readouterr().out
    files = sorted((installed_trees() / "cells").glob("*.yaml"))
    assert len(files) > 5
    pomona(["check", *map(str, files)])
    said = capsys.readouterr().out
    errors = [line.split("error", 1)[1] for line in said.splitlines() if "error[" in line]
    assert all(
        error.startswith(("[file]: devices.", "[missing-key]: devices.")) for error in errors
    ), errors


@pytest.mark.parametrize(
    ("rate", "fits"), [("99 Hz", False), ("100 Hz", True), ("130 Hz", True), ("1 kHz", True)]
)
def test_fingers_that_sample_too_slowly_for_a_grip_are_found_by_the_check(
    rate: str, fits: bool, tmp_path: Path, unconnected: None, capsys: pytest.CaptureFixture[str]
) -> None:
    cell, tree = tmp_path / "slow.yaml", tmp_path / "t.yaml"
    include = "include: emulated.yaml#devices"
    cell.write_text(
        f"include: emulated.yaml\ndevices: {{{include}, fingers: {{{include}/fingers, rate: {rate}}}}}\n"
    )
    tree.write_text('pomona: 1\ntree: t\nroot: {SlipAvoidGrasp: {hold: "{hold}"}}\n')
    assert pomona(["check", str(tree), "--cell", str(cell)]) == (0 if fits else 2)
    assert (
        fits
        or "gives 99 samples a second; a grip needs 100 to 2000"
        in capsys.readouterr().out.replace("\n", "")
    )


def test_check_on_a_cell_connects_nothing_and_takes_every_kind_of_file(
    tmp_path: Path, unconnected: None, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "look.yaml"
    path.write_text(TREE.replace("to: home", "to: hoem"))
    assert pomona(["check", "--cell", "sim", str(path)]) == 2
    assert "look.yaml:16:" in capsys.readouterr().out
    campaign = tmp_path / "many.yaml"
    campaign.write_text("campaign: many\ntree: pick_apple\nvary: {place: [1, 9]}\n")
    cell, fruit = tmp_path / "cell.yaml", tmp_path / "fruit.yaml"
    cell.write_text(
        "kind: mock\nworld: {driver: mock}\ndevices: {arm: {driver: mock-arm, start: hoem}}\n"
    )
    fruit.write_text(
        "name: plum\nmesh: plum.ply\ndimensions: 50 50 50 mm\nsymmetry_axis: [0, -1, 0]\n"
    )
    scenario = tmp_path / "cases.yaml"
    scenario.write_text("tree: pick_apple.yaml\ncases: [{expect: maybe}]\n")
    assert pomona(["check", str(campaign), str(cell), str(fruit), str(scenario)]) == 2
    said = capsys.readouterr().out
    for place in ("many.yaml:3:19", "cell.yaml:3:", "fruit.yaml:2:7", "cases.yaml:2:18"):
        assert place in said
    assert pomona(["schema", "scenario"]) == 0
    assert (
        pomona(["schema", "fruit"])
        == pomona(["schema", "cell"])
        == pomona(["schema", "campaign"])
        == 0
    )


class Carry(Skill):
    """Measure what the hand holds."""

    measures = True

    def run(self) -> None: ...


def test_a_tree_whose_skills_measure_a_success_is_to_declare_one(tmp_path: Path) -> None:
    registry = Registry({"Carry": Carry})
    path = tmp_path / "t.yaml"
    path.write_text("pomona: 1\ntree: t\nroot:\n  sequence:\n    - Carry: {}\n")
    (found,) = judge(read_document(path), registry, {}, None).findings.sorted()
    assert (found.code, found.severity, found.line, found.column) == ("no-success", "warning", 5, 7)
    assert "`success: put_away`" in found.hint
    path.write_text(path.read_text().replace("root", "success: held\nroot"))
    assert not judge(read_document(path), registry, {}, None).findings.sorted()
