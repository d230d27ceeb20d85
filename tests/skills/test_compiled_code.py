"""Compiled code is kept apart from that of other versions of its sources."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.skills import compiled_code
from pomona.skills.compiled_code import FIRST_ONE, HELPER, LAST, PLACE, examine
from pomona.skills.motion.lines import track_poses

INNER = "import numba\n@numba.njit(cache=True)\ndef inner(): return {}\n"
OUTER = (
    "import numba\nfrom inner import inner\n@numba.njit(cache=True)\ndef outer(): return inner()\n"
)
SCRIPT = """
from pathlib import Path

from pomona.skills.compiled_code import PLACE, keep_apart
import os
del os.environ[PLACE]
keep_apart(Path.cwd())
from outer import outer
print(outer(), os.environ[PLACE])
"""


def answer(folder: Path) -> list[str]:
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    paths = os.pathsep.join([str(folder), str(Path(__file__).parents[2])])
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=folder, env={**environment, "PYTHONPATH": paths}, capture_output=True,
        text=True, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.slow
def test_a_change_in_another_file_is_compiled_in(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(OUTER)
    (tmp_path / "inner.py").write_text(INNER.format(1))
    first = answer(tmp_path)
    assert answer(tmp_path) == first
    (tmp_path / "inner.py").write_text(INNER.format(2))
    second = answer(tmp_path)
    assert (first[0], second[0]) == ("1", "2")
    assert first[1] != second[1]
    assert list(Path(first[1]).rglob("*.nbi")), "the first version's code was kept"


def test_a_place_that_a_person_has_chosen_keeps_versions_apart_as_well(tmp_path: Path) -> None:
    """A new version would find names of modules in the old code that are gone, or use its geometry."""
    script = "import os, pomona.skills; print(os.environ['NUMBA_CACHE_DIR'])"
    place = str(tmp_path)
    for _ in "ab":  # a process that another one starts has the same place
        done = subprocess.run(
            [sys.executable, "-c", script], env={**os.environ, PLACE: place}, capture_output=True, text=True,
            timeout=100, check=True,
        )  # fmt: skip
        place = done.stdout.strip()
        assert Path(place).parent == tmp_path
        assert Path(place).name.startswith("compiled-")


def start(place: Path, lines: str) -> list[str]:
    """The warnings of a process that begins a first start with a helper that ends at once."""
    script = "import logging, sys; from pathlib import Path; import pomona.skills.compiled_code as c; c.HELPER = 'this'\n"
    done = subprocess.run(
        [sys.executable, "-c", script + lines], env={**os.environ, PLACE: str(place)}, capture_output=True, text=True,
        timeout=100, check=True,
    )  # fmt: skip
    return done.stderr.splitlines()


def test_the_first_start_is_announced_with_its_duration_and_no_later_one(tmp_path: Path) -> None:
    begin = "[c.begin_first(Path('robot.xml')) for _ in 'ab']; c.wait_for_first(); print(c._beside, file=sys.stderr)"
    said, helper = start(tmp_path, begin)
    assert re.fullmatch(r"compiling the motion kernels, once, about \d\d s", said)
    assert "returncode: 0" in helper or (len(os.sched_getaffinity(0)) < 2 and helper == "None")
    place = tmp_path / Path(os.environ[PLACE]).name  # of this version
    (place / "fingers").mkdir(parents=True)
    (
        place / "fingers" / "fingers.pad_wrench-26.py311.nbi"
    ).touch()  # a driver compiles it when the cell connects
    assert start(tmp_path, begin)[0] == said
    (place / "motion").mkdir()
    (place / "motion" / LAST.replace("*", "20.py311")).touch()
    assert start(tmp_path, begin) == ["None"]


def test_on_one_core_no_process_helps(tmp_path: Path) -> None:
    begin = (
        "c._cores = lambda: 1; c.begin_first(Path('robot.xml')); print(c._beside, file=sys.stderr)"
    )
    said, helper = start(tmp_path, begin)
    assert f"about {FIRST_ONE} s" in said
    assert helper == "None"


def test_the_loop_that_is_compiled_last_exists() -> None:
    module, _, function = LAST.partition("-")[0].partition(".")
    assert track_poses.__module__.endswith(f".{module}")
    assert track_poses.__name__ == function


@pytest.mark.slow
def test_the_helper_compiles_its_half_for_the_process_that_waits(tmp_path: Path) -> None:
    """It runs as a module, and ends when the pipe to its parent closes."""
    words = [sys.executable, "-m", HELPER, str(tmp_path / "no_robot.xml")]
    done = subprocess.run(words, input="", capture_output=True, text=True, timeout=100, check=False)
    assert "No module named" not in done.stderr


@pytest.mark.parametrize(
    ("place", "says", "is_ok"),
    [
        ("kept", "none yet in ", True),
        (
            "cache/pomona/compiled-1",
            "none yet in ",
            True,
        ),
        (
            "file/compiled-1",
            "none yet in ",
            False,
        ),
        ("temporary/compiled-1", "none yet in ", False),
    ],
)
def test_the_place_of_compiled_code_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, says: str, is_ok: bool
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled_code, "TEMPORARY", tmp_path / "temporary")
    monkeypatch.setenv(PLACE, str(tmp_path / place))
    (line,) = examine()
    assert (line.ok, says in line.found) == (is_ok, True)
    assert "NUMBA_CACHE_DIR" in line.advice


def test_where_nothing_is_writable_a_temporary_folder_serves(tmp_path: Path) -> None:
    script = f"import os; os.access = lambda *_: False; import pomona.skills as s; print(os.environ['{PLACE}'])"
    environment = {name: value for name, value in os.environ.items() if name != PLACE}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True,
        timeout=100, check=True,
    )  # fmt: skip
    assert done.stdout.startswith(str(tmp_path / "pomona" / "compiled-"))


def test_where_the_sources_cannot_be_written_it_is_kept_in_the_users_cache(tmp_path: Path) -> None:
    own = "os.access = lambda path, _: 'skills' not in str(path)"
    script = f"import os; {own}; import pomona.skills; print(os.environ['{PLACE}'])"
    environment = {name: value for name, value in os.environ.items() if name != PLACE}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment | {"XDG_CACHE_HOME": str(tmp_path)}, capture_output=True,
        text=True, timeout=100, check=True,
    )  # fmt: skip
    assert done.stdout.startswith(str(tmp_path / "pomona" / "compiled-"))
