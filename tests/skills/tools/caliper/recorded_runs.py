"""Recorded runs with the touches of synthetic picks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from recorded_events import started

from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Published, RunEnded
from tests.skills.tools.caliper.synthetic import recorded

CELL = "name: sim\n"


def write_run(
    folder: Path,
    *touches: dict[str, Any],
    cell: str = CELL,
    name: str = "sim",
    topic: str = "touches",
) -> Path:
    """Record a run with the touches of its picks."""
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    recorder.on_event(started(cell_text=cell, nodes=(), cell=name))
    for i, value in enumerate(touches):
        recorder.on_event(Published(float(i), i, "pick/SlipAvoidGrasp", topic, value))
    recorder.on_event(RunEnded(9.0, 450, "success", None, 450, 9.0, 9.0, None))
    recorder.close()
    return folder


def picks_of(shift: float, count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Picks of a camera that sits `shift` [m] to the right: fruit lie that far along its x axis."""
    rng = np.random.default_rng(seed)
    found = []
    for yaw in rng.uniform(0.0, 2.0 * np.pi, count):
        along = shift * np.cos(yaw) + 0.3e-3 * rng.normal()
        x, y = rng.uniform(-0.15, 0.15, 2)
        found.append(recorded(along, yaw=yaw, x=x, y=y - 0.5))
    return found


def runs_of(root: Path, shift: float, count: int = 12) -> Path:
    for i, touches in enumerate(picks_of(shift, count)):
        write_run(root / f"2026-01-01_10-00-{i:02d}_pick", touches)
    return root
