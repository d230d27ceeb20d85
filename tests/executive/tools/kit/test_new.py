"""The files of `pomona new` work: their tests pass, `pomona check` finds nothing (types: scripts/check_kit.py)."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.registry import Registry
from pomona.tools.kit import cell_folder
from pomona.tools.kit.pieces import (
    EMPTY_TREE,
    EXAMPLE_TREE,
    KINDS,
    KINDS_ELSEWHERE,
    OWN_TREE,
    PACKAGE,
    TEMPLATES,
    Piece,
    PieceNames,
)


@pytest.fixture(scope="module")
def kit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package with one of everything."""
    folder = tmp_path_factory.mktemp("new")
    assert main(["new", "package", "my_fruit_kit", "--into", str(folder)]) == 0
    package = folder / "my_fruit_kit"
    pieces = "node forgive", "driver WallCamera", "gripper Clamp", "arm Reacher", "skill WeighFruit"
    for kind, name in map(str.split, pieces):
        assert main(["new", kind, name, "--into", str(package)]) == 0
    return package


def test_every_template_is_written_by_a_piece() -> None:
    pieces = *KINDS.values(), *KINDS_ELSEWHERE.values(), PACKAGE, EXAMPLE_TREE, OWN_TREE, EMPTY_TREE
    written = {path for piece in pieces for path in piece.templates}
    there = {str(path.relative_to(TEMPLATES)) for path in TEMPLATES.rglob("*") if path.is_file()}
    assert {path for path in there - written if "__pycache__" not in path} == {
        f"devices/{name}" for name in cell_folder.FILES
    }


@pytest.mark.parametrize("kind", [*KINDS, *KINDS_ELSEWHERE])
def test_no_name_of_a_template_is_left_in_the_files(kind: str) -> None:
    piece = {**KINDS, **KINDS_ELSEWHERE}[kind]
    names = PieceNames("zzz_kind", "ZzzKind", "zzz_package")
    for path, data in piece.files(names, Path()).items():
        text = str(path) + ("" if path.suffix == ".ply" else data.decode())
        assert "my_package" not in text
        assert piece.name not in text.lower()
        assert "zzz" in text.lower()


@pytest.mark.slow
def test_its_tests_pass(kit: Path) -> None:
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "."]
    done = subprocess.run(words, cwd=kit, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "14 passed" in done.stdout


def test_its_tree_follows_its_scenario(kit: Path, monkeypatch, capsys) -> None:
    monkeypatch.syspath_prepend(str(kit))
    hover = importlib.import_module("my_fruit_kit.hover").Hover
    monkeypatch.setattr(Registry, "installed", staticmethod(lambda: Registry({"Hover": hover})))
    monkeypatch.chdir(kit)
    assert main(["test", "trees/my_fruit_kit_test.yaml"]) == 0
    assert "3 passed" in capsys.readouterr().out


def test_every_piece_is_found_by_an_entry_point(kit: Path) -> None:
    text = (kit / "pyproject.toml").read_text()
    assert text.count('[project.entry-points."pomona.skills"]') == 1
    for line in (
        'Hover = "my_fruit_kit.hover:Hover"',
        'WeighFruit = "my_fruit_kit.weigh_fruit:WeighFruit"',
        'forgive = "my_fruit_kit.forgive:ForgiveType"',
        'wall_camera = "my_fruit_kit.wall_camera:connect"',
        'clamp = "my_fruit_kit.clamp:connect"',
        'reacher = "my_fruit_kit.reacher:connect"',
    ):
        assert line in text


@pytest.mark.parametrize("piece", [OWN_TREE, EMPTY_TREE], ids=["with skills", "alone"])
def test_a_tree_passes_the_check_and_runs_dry(
    piece: Piece, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pomona.tools.kit.command_new.OWN_TREE", piece)
    assert main(["new", "tree", "look_around", "--into", str(tmp_path)]) == 0
    tree = str(tmp_path / "look_around.yaml")
    assert main(["check", tree]) == 0
    assert main(["run", tree, "--dry", "--no-record", "--quiet"]) == 0


@pytest.mark.parametrize(
    ("kind", "name", "module"), [("skill", "Detect", "pomona.skills"), ("node", "retry", "nodes")]
)
def test_a_name_that_is_taken_is_refused(
    kind: str, name: str, module: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", kind, name, "--into", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"{kind} '{name}' is installed already" in said
    assert module in said
    assert not list(tmp_path.iterdir())


def test_cells_and_fruit_are_right(tmp_path: Path) -> None:
    for kind, name, file in (("cell", "bench", "bench.yaml"), ("fruit", "plum", "plum/fruit.yaml")):
        assert main(["new", kind, name, "--into", str(tmp_path)]) == 0
        assert main(["check", str(tmp_path / file)]) == 0


def test_a_piece_without_a_package_begins_one(tmp_path: Path) -> None:
    assert main(["new", "skill", "Weigh", "--into", str(tmp_path)]) == 0
    assert (tmp_path / "weigh" / "pomona_weigh" / "weigh.py").is_file()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("skill", "Hover"), "is there already"),
        (("skill", "1st"), "is not a valid name"),
        (("node", "while"), "means something else"),
        (("package", "pomona"), "means something else"),
    ],
)
def test_impossible_values_are_refused(
    kit: Path, capsys: pytest.CaptureFixture[str], arguments, said
) -> None:
    before = sorted(kit.rglob("*"))
    assert main(["new", *arguments, "--into", str(kit)]) == 2
    assert said in capsys.readouterr().err
    assert sorted(kit.rglob("*")) == before


@pytest.mark.slow
def test_folders_of_a_user_with_common_names_do_not_hide_pomona(tmp_path: Path) -> None:
    for name in ("executive", "skills", "drivers", "trees"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").touch()
    script = "import sys; sys.path.insert(0, '.')\n"
    script += "from pomona.executive.cli import main; sys.exit(main(['check', 'pick_apple']))"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_next_step_is_named(tmp_path, capsys):
    for words, said in (
        (["package", "orchard"], f"next: pip install -e {tmp_path / 'orchard'}, after which"),
        (["cell", "bench"], f"next: pomona check {tmp_path / 'bench.yaml'}"),
    ):
        assert main(["new", *words, "--into", str(tmp_path)]) == 0
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", ["tree hang", "package my_kit", "skill Weigh", "cell my_cell --arm ur5e --hand hand-e"]
)
def test_a_folder_that_takes_no_files_is_named_with_the_way_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str
) -> None:
    (tmp_path / "file").write_text("no folder")
    assert main(["new", *words.split(), "--into", str(tmp_path / "file")]) == 2
    said = capsys.readouterr().err
    assert re.search(r"/file\S* cannot be written: .*; `--into DIR` names a folder", said), said
    assert (tmp_path / "file").read_text() == "no folder"
