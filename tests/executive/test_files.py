"""Trees and cells by name, and their defaults."""

from pathlib import Path

import pytest

from pomona.executive.errors import UsageError
from pomona.executive.files import default_name, find_cell, find_tree
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


def test_a_folder_of_an_installed_name_hides_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "frames").mkdir()
    monkeypatch.chdir(tmp_path)
    assert find_cell("frames") == installed_trees() / "cells" / "frames.yaml"
