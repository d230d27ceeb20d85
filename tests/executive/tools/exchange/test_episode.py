"""A record as an episode: the newest that was measured, at equal steps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_events import FAILED, write
from recorded_motion import END, JOINTS, LOOKS, PARTS, joints, record_motion, wrenches

from pomona.executive.errors import UsageError
from pomona.tools.exchange.episode import Episode, read_episode


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Episode:
    return read_episode(record_motion(tmp_path_factory.mktemp("records") / "one"), 20.0)


def test_steps_are_equal_and_begin_when_everything_was_seen(episode: Episode) -> None:
    assert np.allclose(np.diff(episode.times), 0.05)
    assert episode.times[0] == pytest.approx(LOOKS[0])
    assert episode.times[-1] == pytest.approx(END)
    assert (episode.name, episode.tree, episode.succeeded) == ("one", "reach_out", True)


def test_each_value_is_the_newest_that_was_measured(episode: Episode) -> None:
    newest = np.floor(episode.times * 50.0 + 1e-6) / 50.0
    assert episode.state_names == (*(f"arm_joint_{k + 1}" for k in range(JOINTS)), "gripper_width")
    assert np.allclose(episode.state[:, :JOINTS], joints(newest), atol=2e-6)
    assert np.allclose(episode.state[:, JOINTS], 0.05 + 0.01 * newest, atol=2e-6)
    assert episode.wrench_names == tuple(f"fingers_{part}" for part in PARTS)
    assert np.allclose(
        episode.wrench, wrenches(np.floor(episode.times * 500.0 + 1e-6) / 500.0), atol=5e-6
    )


def test_the_action_is_the_next_state_and_the_look_is_the_newest_with_depth(
    episode: Episode,
) -> None:
    assert np.array_equal(episode.action[:-1], episode.state[1:])
    assert np.array_equal(episode.action[-1], episode.state[-1])
    at, files = episode.colour
    assert len(files) == len(LOOKS)
    assert at.tolist() == [int(t >= LOOKS[1] - 1e-9) for t in np.round(episode.times, 6)]
    assert episode.size == (64, 48)


def test_without_looks_there_are_no_images_and_without_joints_nothing_to_learn(
    tmp_path: Path,
) -> None:
    blind = read_episode(
        record_motion(tmp_path / "blind", looks=(), outcome="failure", end=0.4), 10.0
    )
    assert (blind.colour, blind.depth, blind.size, blind.succeeded) == (None, None, None, False)
    with pytest.raises(UsageError, match="holds no joints"):
        read_episode(write(tmp_path / "dry", FAILED), 10.0)
    with pytest.raises(UsageError, match="ends before each device has delivered data"):
        read_episode(record_motion(tmp_path / "late", looks=(0.3,), end=0.3), 10.0)
