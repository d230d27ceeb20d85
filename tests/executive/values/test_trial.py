"""A file is tried in a process of its own: what takes too long or fills the memory ends there, with a reason."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

import pytest

from pomona.executive.values.trial import trial

READER = """
import os, time

def fine(path): assert path == "a file"
def wrong(path): raise ValueError("has no wheels")
def endless(path):
    while True: pass
def full(path): return b"x" * (1 << 34)
def dead(path): os.abort()
def silent(path): os._exit(0)
"""


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "reader_on_trial.py").write_text(READER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    return "reader_on_trial"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit a process's memory")
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("fine", ""),
        ("wrong", "has no wheels"),
        ("endless", "takes more than 1 s of processor time"),
        ("full", "needs more than 64 MB of memory"),
        ("dead", "needs more than 64 MB of memory, or ends its reader"),
        ("missing", "was not read: the process that tried it ended with status 1"),
        ("silent", "was not read: the process that tried it gave no answer"),
    ],
)
def test_a_trial_gives_the_reason(reader: str, name: str, reason: str) -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = trial(f"{reader}:{name}", "a file", memory=64 << 20, processor_s=1)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)
    assert after.ru_utime - before.ru_utime < 4.0
