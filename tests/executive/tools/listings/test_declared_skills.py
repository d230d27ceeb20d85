"""Declarations of skills are known without an import, and never from outdated sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from importlib.metadata import EntryPoint

import pytest

from pomona.executive.language import check, read
from pomona.executive.language.value_types import NotLoadedError
from pomona.executive.registry import Registry
from pomona.tools.listings import declared_skills as declared
from pomona.tools.listings.declared_skills import with_declarations
from pomona.tools.listings.schema import schema

SOURCE = '''
from dataclasses import dataclass
from enum import Enum
import numpy as np
from pomona.executive.ports import LENGTH, Port, Ports
from pomona.executive.skill import Skill

class Arm: pass

class Mood(Enum):
    CALM = "calm"
    WILD = "wild"

@dataclass(frozen=True)
class Inner:
    width: float
    mood: Mood

@dataclass(frozen=True)
class Outer:
    inner: Inner
    all: tuple[Inner, ...]
    pose: np.ndarray
    @property
    def first(self) -> Inner | None:
        return None

@dataclass(frozen=True)
class Narrow(Outer):
    pass

class Give(Skill):
    """Gives."""
    inputs = Ports(
        far=Port(LENGTH, default="1 cm", max="1 m"), mood=Port(Mood, default=Mood.CALM), inner=Port(Inner, default=None)
    )
    outputs = Ports(narrow=Narrow)
    devices = (Arm,)
    failures = ("NOT_NOW",)
    renamed_failures = {"NO": "NOT_NOW"}

class Take(Skill):
    """Takes."""
    inputs = Ports(outer=Outer, word=Port(str, choices=("a", "b"), was="speech"))
'''

TREE = """\
pomona: 1
tree: t
root:
  sequence:
    - Give: {narrow: "{n}", far: 2 mm, mood: wild}
    - check: "{n.inner.mood} == CALM and {n.first.width} > 0.1 and {n.all[0].width} < 3"
    - Take: {outer: "{n}", word: a}
"""
WRONG = [
    TREE.replace("word: a", "word: c"),
    TREE.replace("word: a", "speech: a"),
    TREE.replace("far: 2 mm", "far: 2 m"),
    TREE.replace("mood: wild", "mood: wil"),
    TREE.replace("n.inner.mood} == CALM", "n.inner.mod} == CALM"),
    TREE.replace("== CALM", "== CLAM"),
    TREE.replace(
        'Take: {outer: "{n}"',
        'Give: {narrow: "{m}", inner: "{n}"}\n    - Take: {outer: "{m.inner}"',
    ),
    TREE.replace("n.all[0]", "n.inner[0]"),
    TREE + "  retry: 2\n  retry_if: failure.code == NO\n",
]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Two skills of a package that is imported when they are, and where their declarations are kept."""
    source = tmp_path / "kept_words.py"
    source.write_text(textwrap.dedent(SOURCE))
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    points = [EntryPoint(name, f"kept_words:{name}", declared.GROUP) for name in ("Give", "Take")]
    for module in (declared, sys.modules[Registry.__module__]):
        monkeypatch.setattr(module, "entry_points", lambda group: points)
    yield source
    sys.modules.pop("kept_words", None)


def loaded(found: Registry) -> bool:
    return found["Give"] is getattr(sys.modules.get("kept_words"), "Give", None)


def test_the_second_time_they_come_from_the_file(package):
    assert loaded(declared.declared_skills())
    sys.modules.pop("kept_words")
    assert not loaded(declared.declared_skills())
    assert "kept_words" not in sys.modules


def test_stand_ins_are_checked_like_the_skills_themselves(package):
    real = declared.declared_skills()
    stand_ins = declared.declared_skills()
    assert loaded(real)
    assert not loaded(stand_ins)
    assert stand_ins.listing() == real.listing()
    assert schema(stand_ins) == schema(real)
    assert check(read(TREE, "t.yaml"), stand_ins) == []
    for text in WRONG:
        expected = check(read(text, "t.yaml"), real)
        assert expected, text
        assert check(read(text, "t.yaml"), stand_ins) == expected


def test_a_check_that_needs_the_class_gets_it(package):
    declared.declared_skills()
    text = TREE.replace("mood: wild", "inner: {width: 1, mood: calm}")
    with pytest.raises(NotLoadedError):
        check(read(text, "t.yaml"), declared.declared_skills())
    assert with_declarations(lambda skills: check(read(text, "t.yaml"), skills)) == []
    broken = text.replace("width: 1", "widht: 1")
    assert [
        f.code for f in with_declarations(lambda skills: check(read(broken, "t.yaml"), skills))
    ] == ["value"]


def test_a_changed_source_makes_them_afresh(package):
    declared.declared_skills()
    sys.modules.pop("kept_words")
    package.write_text(package.read_text().replace('"NOT_NOW"', '"NEVER_EVER"'))
    assert declared.declared_skills()["Give"].failures == ("NEVER_EVER",)
    assert "kept_words" in sys.modules


@pytest.mark.parametrize(
    "damage",
    [b"", b"{", b"[]", b'{"sources": {}}', b'{"sources": {}, "classes": [{}], "skills": {}}'],
)
def test_a_damaged_file_is_as_good_as_none(package, tmp_path, damage):
    declared.declared_skills()
    (kept,) = (tmp_path / "cache" / "pomona").iterdir()
    kept.write_bytes(damage)
    assert loaded(declared.declared_skills())
    assert json.loads(kept.read_bytes())["skills"].keys() == {"Give", "Take"}


def test_nothing_is_kept_when_a_skill_cannot_be_imported(package, tmp_path):
    package.write_text(package.read_text().replace("class Give", "class Gve"))
    assert declared.declared_skills().problems.keys() == {"Give"}
    assert not (tmp_path / "cache").exists()


def test_a_folder_that_cannot_be_written_is_no_problem(package, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert loaded(declared.declared_skills())


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", ["--help", "show pick_apple", "skills", "schema", "export pick_apple"]
)
def test_small_commands_import_no_skill(command, tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    if command not in ("--help", "show pick_apple"):
        subprocess.run(
            [sys.executable, "-m", "pomona.executive.cli", "skills"], env=environment, check=True
        )
    script = (
        "import sys; from pomona.executive.cli import main\n"
        f"try: main({command.split()!r})\n"
        "except SystemExit: pass\n"
        "heavy = ('torch', 'numba', 'scipy', 'mujoco', 'trimesh', 'mcap')\n"
        "heavy += ('pomona.skills.plan', 'pomona.executive.execute')\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.stdout.splitlines()[-1] == "[]", done.stderr
