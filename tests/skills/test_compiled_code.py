"""Compiled code is kept apart from that of other versions of its sources."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.skills.compiled_code import FIRST, PLACE

INNER = "import numba\n@numba.njit(cache=True)\ndef inner(): return {}\n"
OUTER = "import numba\nfrom inner import inner\n@numba.njit(cache=True)\ndef outer(): return inner()\n"
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


def test_a_place_that_a_person_has_chosen_is_left(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    script = "import os, skills; print(os.environ['NUMBA_CACHE_DIR'])"
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=100)
    assert done.stdout.strip() == str(tmp_path)


def test_the_first_start_is_told_and_no_later_one(tmp_path: Path) -> None:
    script = "from pomona.skills.compiled_code import tell_the_first as tell; tell(); tell()"

    def said() -> str:
        done = subprocess.run(
            [sys.executable, "-c", script], env={**os.environ, PLACE: str(tmp_path)}, capture_output=True, text=True,
            timeout=100, check=True,
        )  # fmt: skip
        return done.stderr

    assert said() == f"{FIRST}\n"
    (tmp_path / "kernel.nbi").touch()
    assert said() == ""


def test_where_the_sources_cannot_be_written_it_is_kept_in_the_users_cache(tmp_path: Path) -> None:
    script = f"import os; os.access = lambda *_: False; import pomona.skills; print(os.environ['{PLACE}'])"
    environment = {name: value for name, value in os.environ.items() if name != PLACE}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment | {"XDG_CACHE_HOME": str(tmp_path)}, capture_output=True,
        text=True, timeout=100, check=True,
    )  # fmt: skip
    assert done.stdout.startswith(str(tmp_path / "pomona" / "compiled-"))
