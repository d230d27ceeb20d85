"""Trees and cells by name, and their defaults."""

from pathlib import Path

import pytest

from pomona.executive.errors import UsageError
from pomona.executive.files import default_name, find_cell, find_tree
from pomona.executive.language.check import read_document, usual_cell
from pomona.executive.language.model import Document
from pomona.executive.values.findings import TreeFileError
from pomona.executive.values.installation import installed_trees


def test_the_default_is_installed() -> None:
    assert find_tree(default_name("tree")).is_file()
    assert find_cell(default_name("cell")).is_file()


def test_a_name_that_is_nearly_one_is_asked_back_and_a_path_is_not() -> None:
    with pytest.raises(UsageError, match=r"did you mean 'sim'\?"):
        find_cell("sin")
    with pytest.raises(UsageError) as failed:
        find_cell("./sin")
    assert "did you mean" not in str(failed.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "lab/cel.yaml",
            r"^no cell file 'lab/cel\.yaml': lab/cel\.yaml does not exist; did you mean 'cell\.yaml'\?$",
        ),
        (
            "lap/cell.yaml",
            r"^no cell file 'lap/cell\.yaml': lap does not exist; did you mean 'lab'\?$",
        ),
        ("lab/x/y/cell.yaml", r"^no cell file 'lab/x/y/cell\.yaml': lab/x does not exist$"),
        ("lab/cell.yaml/cell.yaml", r"cell\.yaml/cell\.yaml does not exist$"),
        (
            "orchrd_7.yaml",
            r"^no cell file 'orchrd_7\.yaml'; did you mean 'orchard_7\.yaml'\? installed: ",
        ),
    ],
)
def test_a_path_that_does_not_exist_is_named_with_the_nearest_one(
    name: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lab").mkdir()
    for file in ("lab/cell.yaml", "orchard_7.yaml"):
        (tmp_path / file).touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=said):
        find_cell(name)


def test_a_folder_of_an_installed_name_hides_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "frames").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_cell("frames") == installed_trees() / "cells" / "frames.yaml"


TREE = "pomona: 1\ntree: t\n{}root:\n  succeed: {{}}\n"


def document(folder: Path, line: str) -> Document:
    tree = folder / "t.yaml"
    tree.write_text(TREE.format(line))
    return read_document(tree)


def test_a_tree_names_its_cell_by_name_and_by_a_file_beside_it(tmp_path: Path) -> None:
    assert usual_cell(document(tmp_path, "")).stem == default_name("cell")
    assert usual_cell(document(tmp_path, "cell: sim_crate\n")) == find_cell("sim_crate")
    own = tmp_path / "mine.yaml"
    own.write_text("cell: mine\n")
    assert usual_cell(document(tmp_path, "cell: mine.yaml\n")) == own


def test_a_cell_that_no_file_describes_is_refused_where_the_tree_names_it(tmp_path: Path) -> None:
    with pytest.raises(
        TreeFileError, match=r"t.yaml:3:7: error\[no-cell\]: no cell file 'sim_crat'; .*sim_crate"
    ):
        usual_cell(document(tmp_path, "cell: sim_crat\n"))
    assert [found.code for found in document(tmp_path, "cell: [a]\n").findings] == ["shape"]
