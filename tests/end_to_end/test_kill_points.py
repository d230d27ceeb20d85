"""Real runs on the simulated cell, ended at random points with every signal there is."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.slow
def test_wherever_a_run_is_ended_its_record_its_status_and_its_processes_are_right() -> None:
    # Other tests share the processor. `make kill-points` checks the bounds without slack.
    command = [
        sys.executable,
        "-m",
        "benchmarks.kill_points",
        "--points",
        "6",
        "--seed",
        "17",
        "--slack",
        "8",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 points" in done.stdout
