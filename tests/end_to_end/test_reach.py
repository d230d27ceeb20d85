"""The way from records to a learned reach, without physics: a few demonstrations, goals that were never shown."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from recorded_events import started

from benchmarks import reach
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import RunEnded
from pomona.skills.motion.robot import RobotModel
from pomona.tools.exchange.lerobot import export_lerobot

pytest.importorskip("pyarrow", reason="the extra lerobot (pyarrow, 55 MB) is not installed")

START = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
MOVES, RESTS, RATE = 0.9, 0.4, 50
"""Seconds of a motion and of the rest behind it, and samples a second."""


def moved(stops: list[np.ndarray]) -> np.ndarray:
    """The arm at `RATE` as it moves from stop to stop and rests at each."""
    s = np.linspace(0.0, 1.0, round(MOVES * RATE))[:, None]
    parts = [np.tile(stops[0], (round(RESTS * RATE), 1))]
    for a, b in pairwise(stops):
        parts += [
            a + (10 * s**3 - 15 * s**4 + 6 * s**5) * (b - a),
            np.tile(b, (round(RESTS * RATE), 1)),
        ]
    return np.concatenate(parts)


def recorded(folder: Path, q: np.ndarray) -> Path:
    folder.mkdir()
    recorder = Recorder(folder)
    recorder.on_event(started(run=folder.name, tree="demonstration"))
    for k in range(0, len(q) - 4, 5):
        stamps = np.arange(k, k + 5) / RATE
        part = {f"q_{i + 1}_rad": q[k : k + 5, i] for i in range(q.shape[1])}
        recorder.read(stamps[-1], k, {"arm": {"stamp_s": stamps, **part}})
    end = len(q) / RATE
    recorder.on_event(RunEnded(end, len(q), "success", None, len(q), end, end, None))
    recorder.close()
    return folder


@pytest.fixture(scope="module")
def expert() -> reach.Expert:
    return reach.Expert.of(RobotModel.load(reach.ROBOT), START)


def test_the_expert_puts_the_tools_point_on_every_goal_and_near_goals_near_each_other(
    expert: reach.Expert,
) -> None:
    goals = reach.drawn(50, seed=5)
    for goal in goals:
        q = expert.joints(goal)
        np.testing.assert_allclose(expert.robot.tcp(q)[:3, 3], goal, atol=1e-6)
        aside = np.abs(expert.joints(goal + np.array([0.003, 0.0, 0.0])) - q).max()
        assert aside < np.radians(4.0)
        assert np.abs(q[6]) < np.radians(90.0)  # far from where joint 7 ends


def test_of_a_pair_of_motions_the_second_is_learned_and_a_lone_one_is_refused() -> None:
    a, b, c = np.zeros(7), np.full(7, 0.5), np.full(7, -0.2)
    q = moved([a, b, c, a, b])[:: RATE // reach.RATE]
    state, action = q, np.concatenate([q[1:], q[-1:]])
    found = reach.reaches(state, action)
    ends = [(part[0][0], part[-1][0]) for part in found]
    np.testing.assert_allclose(ends, [(0.5, -0.2), (0.0, 0.5)], atol=1e-3)
    with pytest.raises(SystemExit, match="pairs"):
        reach.reaches(state[:80], action[:80])


def test_a_clone_of_recorded_reaches_comes_to_goals_that_were_never_shown(
    expert: reach.Expert, tmp_path: Path
) -> None:
    begins, goals = reach.beginnings(expert, 48, seed=3), reach.drawn(48, seed=1)
    records = []
    for run in range(2):
        part = range(24 * run, 24 * (run + 1))
        stops = [stop for k in part for stop in (begins[k], expert.joints(goals[k]))]
        records.append(recorded(tmp_path / f"run_{run}", moved([START, *stops])))
    export_lerobot(records, tmp_path / "dataset", reach.RATE, "reach the goals")
    clone = reach.train(tmp_path / "dataset", tmp_path / "reach.npz", rounds=800)
    away = reach.tried(clone, expert.robot, START, reach.drawn(20, seed=2))
    assert (away <= reach.NEAR).sum() >= 18
    untrained = reach.train(tmp_path / "dataset", tmp_path / "untrained.npz", rounds=5)
    assert (
        reach.tried(untrained, expert.robot, START, reach.drawn(20, seed=2)) <= reach.NEAR
    ).sum() == 0
