"""Which commit of Pomona is running."""

from __future__ import annotations

import subprocess
from pathlib import Path

_HERE = Path(__file__).resolve().parents[1]


def commit_here() -> str:
    """Short hash of the source's commit, with a + when files differ from it; empty outside a git checkout."""
    commit = _git("rev-parse", "--short=10", "HEAD")
    changed = _git("status", "--porcelain", "--untracked-files=no")
    return commit + ("+" if commit and changed else "")


def _git(*arguments: str) -> str:
    command = ["git", "--no-optional-locks", "-C", str(_HERE), *arguments]  # reading must not lock the repository
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10.0)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
