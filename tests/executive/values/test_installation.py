"""The pip commands fit the origin of the installed copy: checkout, wheel file, repository, index."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from pomona.executive.values import installation
from pomona.executive.values.installation import entry_points, install_extra, pip, reinstall

Origin = dict[str, object]


@pytest.fixture
def origin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Origin]:
    """The record of the installation's origin, for a shell in which this environment's pip is `pip`."""
    record: Origin = {}
    text = lambda _name: json.dumps(record) if record else None  # noqa: E731
    monkeypatch.setattr(installation, "metadata_of", lambda _name: SimpleNamespace(read_text=text))
    monkeypatch.setattr(installation, "distribution", lambda: "pomona")
    monkeypatch.setattr("shutil.which", lambda _name: str(Path(sys.executable).with_name("pip")))
    return record  # type: ignore[return-value]


def test_from_an_index_the_name_is_enough(origin: Origin) -> None:
    assert install_extra("torch") == "pip install 'pomona[torch]'"
    assert reinstall("pomona") == "pip install --force-reinstall --no-deps pomona"
    assert reinstall("pomona", requirements=True) == "pip install --force-reinstall pomona"


def test_an_editable_checkout_is_installed_again_with_the_extra(
    origin: Origin, tmp_path: Path
) -> None:
    origin |= {"url": tmp_path.as_uri(), "dir_info": {"editable": True}}
    assert install_extra("torch") == f"pip install -e '{tmp_path}[torch]'"
    assert reinstall("pomona") == f"pip install --force-reinstall --no-deps -e {tmp_path}"


def test_a_checkout_that_was_copied_keeps_being_copied(origin: Origin, tmp_path: Path) -> None:
    origin |= {"url": tmp_path.as_uri(), "dir_info": {}}
    assert install_extra("lsp") == f"pip install '{tmp_path}[lsp]'"


def test_a_wheel_file_is_named_also_with_a_space_in_its_path(
    origin: Origin, tmp_path: Path
) -> None:
    wheel = tmp_path / "my files" / "pomona-0.1.0-py3-none-any.whl"
    wheel.parent.mkdir()
    wheel.touch()
    origin |= {"url": wheel.as_uri(), "archive_info": {}}
    assert install_extra("torch") == f"pip install '{wheel}[torch]'"
    wheel.unlink()
    assert (
        install_extra("torch")
        == f"pip install '{wheel}[torch]'  # {wheel} is gone: name its new place"
    )


def test_a_repository_is_named_with_its_commit(origin: Origin) -> None:
    origin |= {
        "url": "https://example.org/pomona.git",
        "vcs_info": {"vcs": "git", "commit_id": "770d701"},
    }
    assert (
        install_extra("lsp")
        == "pip install 'pomona[lsp] @ git+https://example.org/pomona.git@770d701'"
    )


def test_a_wheel_behind_an_address_is_named_by_it(origin: Origin) -> None:
    origin |= {"url": "https://example.org/pomona-0.1.0-py3-none-any.whl", "archive_info": {}}
    assert (
        install_extra("lsp")
        == "pip install 'pomona[lsp] @ https://example.org/pomona-0.1.0-py3-none-any.whl'"
    )


def test_this_checkout_is_found_by_pips_metadata() -> None:
    assert "[torch]" in install_extra("torch")
    assert installation._origin("no-such-distribution") == {}


def test_another_environments_pip_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _name: "/usr/bin/pip")
    assert pip() == f"{sys.executable} -m pip"
    monkeypatch.setattr("shutil.which", lambda _name: None)
    assert pip() == f"{sys.executable} -m pip"


def test_entry_points_of_a_package_are_found_as_soon_as_it_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    assert list(entry_points(group="pomona.fruit_of_the_day")) == []
    os.utime(
        tmp_path, (0, 0)
    )  # an installation later: a clock of the file system may not have gone on
    (tmp_path / "pear-1.0.dist-info").mkdir()
    (tmp_path / "pear-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: pear\nVersion: 1.0\n"
    )
    (tmp_path / "pear-1.0.dist-info" / "entry_points.txt").write_text(
        "[pomona.fruit_of_the_day]\npear = pear:Pear\n"
    )
    assert [point.name for point in entry_points(group="pomona.fruit_of_the_day")] == ["pear"]
