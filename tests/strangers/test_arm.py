"""An arm on `PathArm` in a stranger's package: its driver moves and stops, and a cell file connects it for a run."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.drivers import MotionRefused, MotionState, Trajectory
from pomona.executive import ManualClock
from tests.strangers.installed import HERE, pomona

ROBOT = HERE.parents[1] / "trees" / "robots" / "ur5e_wsg32.xml"
ARM = HERE / "loop_arm"
CELL = f"""name: loop
kind: real
workspace:
  lower: -1 -1 -1 m
  upper: 1 1 1 m
devices:
  arm: {{driver: loop-arm, robot: {ROBOT}}}
"""
TREE = "pomona: 1\ntree: nod\nroot:\n  Nod: {turn: 10 deg, duration: 1 s}\n"


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The driver without a thread of its own: each step is called here."""
    monkeypatch.syspath_prepend(str(ARM))
    made = import_module("loop_arm").LoopArm("arm", ManualClock(), ROBOT)
    made.step()
    return made


def turn_of(q: np.ndarray) -> Trajectory:
    """A turn of the last joint by 0.4 rad within 2 s, at rest at both ends."""
    t = np.linspace(0.0, 2.0, 101)
    x, last = t / 2.0, np.eye(len(q))[-1]
    way = 0.4 * (10 * x**3 - 15 * x**4 + 6 * x**5)
    qd, qdd = 0.2 * (30 * x**2 - 60 * x**3 + 30 * x**4), 0.1 * (60 * x - 180 * x**2 + 120 * x**3)
    return Trajectory(t, q + np.outer(way, last), np.outer(qd, last), np.outer(qdd, last))


def test_it_passes_the_path_at_its_times_and_ends_there(arm: Any) -> None:
    start = arm.state().q
    motion, began, seen = arm.follow(turn_of(start)), arm._clock.now(), {}
    while not motion.settled:
        arm.step()
        seen[round(arm._clock.now() - began, 3)] = arm.state().q[-1] - start[-1]
    assert motion.state is MotionState.DONE
    assert seen[1.0] == pytest.approx(0.2, abs=0.01)
    assert arm.state().q[-1] - start[-1] == pytest.approx(0.4, abs=1e-9)


def test_a_safe_stop_brings_it_to_rest_on_the_path_until_it_is_acknowledged(arm: Any) -> None:
    start = arm.state().q
    motion = arm.follow(turn_of(start))
    for _ in range(500):
        arm.step()
    arm.safe_stop("a test")
    while not motion.settled:
        arm.step()
    assert motion.state is MotionState.STOPPED
    assert 0.1 < arm.state().q[-1] - start[-1] < 0.35
    with pytest.raises(MotionRefused, match="a test"):
        arm.follow(turn_of(arm.state().q))
    arm.acknowledge()
    assert arm.follow(turn_of(arm.state().q)).state is MotionState.RUNNING


@pytest.mark.slow  # a run on a real cell: in the cell's time, with its supervisor
def test_a_cell_file_connects_it_and_a_skill_moves_it(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text(CELL)
    (tmp_path / "nod.yaml").write_text(TREE)
    done = pomona("run", "nod.yaml", "--cell", "cell.yaml", package=ARM, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "✓ nod  succeeded" in done.stdout
