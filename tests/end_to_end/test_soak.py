"""A short soak: runs in one process leave nothing behind."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.slow
def test_many_dry_runs_in_one_process_hold_memory_handles_and_threads_flat() -> None:
    command = [sys.executable, "-m", "benchmarks.soak", "--picks", "40", "--dry"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "✓ handles" in done.stdout
