"""A learned policy moves the arm within its limits, or gives the reason; a file without one moves nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.policy import policy_network
from pomona.applications.policy.policy import Policy
from pomona.applications.policy.policy_network import (
    PolicyNetwork,
    UnusablePolicy,
    read_policy,
    write_policy,
)
from pomona.drivers.errors import DeviceLost
from pomona.drivers.interfaces import Arm, ArmState, StreamedArm
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.tools.mock import MockArm, MockClock

DOF = 7
JOINTS = tuple(f"arm_joint_{k + 1}" for k in range(DOF))
START = np.array([-1.3, -0.3, -0.2, -0.2, 0.1, -1.2, 0.0])
END = START + np.array([0.4, -0.2, 0.1, 0.3, -0.2, 0.1, 0.5])


def network(**changes: Any) -> PolicyNetwork:
    """One layer that goes a third of the way to `END`, wherever the goal is."""
    W = np.zeros((DOF + 3, DOF))
    W[:DOF] = -np.eye(DOF) / 3.0
    scales = (np.zeros(DOF + 3), np.ones(DOF + 3), np.zeros(DOF), np.ones(DOF))
    return replace(PolicyNetwork(JOINTS, 10.0, *scales, layers=((W, END / 3.0),)), **changes)


class Setting:
    def __init__(self, folder: Path) -> None:
        self.clock = MockClock()
        self.arm, self.file = MockArm(self.clock, START), folder / "policy.npz"
        self.said: list[np.ndarray] = []
        self.clock.each_step.append(lambda: self.said.append(self.arm.q.copy()))
        write_policy(self.file, network())

    def drive(self, each_tick: Callable[[int], None] | None = None, **inputs: Any) -> SkillEnd:
        given = {"weights": str(self.file), "x": 0.1, "y": -0.4, "z": 0.1, **inputs}
        how = (
            {"interrupt_after": inputs.pop("interrupt_after", None)}
            if "interrupt_after" in inputs
            else {}
        )
        given.pop("interrupt_after", None)
        devices = {Arm: self.arm, StreamedArm: self.arm}
        return drive(Policy(), given, devices, clock=self.clock, each_tick=each_tick, **how)

    def within_limits(self) -> None:
        limits, step = self.arm.limits, self.clock_step
        for k, limit in ((1, limits.velocity), (2, limits.acceleration)):
            rate = np.diff(np.array(self.said), k, axis=0) / step**k
            assert (np.abs(rate).max(axis=0) <= 1.01 * limit + 1e-6).all()

    @property
    def clock_step(self) -> float:
        from pomona.tools.mock.hand import PERIOD

        return PERIOD


@pytest.fixture
def setting(tmp_path: Path) -> Setting:
    return Setting(tmp_path)


def test_it_goes_where_the_policy_wants_within_the_limits_and_ends_when_it_wants_no_more(
    setting: Setting,
) -> None:
    outcome = setting.drive()
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(setting.arm.q, END, atol=np.radians(1.6))
    assert setting.arm.settled()
    setting.within_limits()


def test_its_file_comes_back_as_it_was_written(setting: Setting) -> None:
    written, read = network(), read_policy(setting.file)
    assert (read.joints, read.rate) == (JOINTS, 10.0)
    np.testing.assert_allclose(
        read.set_point(START, np.zeros(3)), written.set_point(START, np.zeros(3)), atol=1e-6
    )
    two = network(
        layers=((np.eye(DOF + 3), np.zeros(DOF + 3)), (np.ones((DOF + 3, DOF)), np.zeros(DOF)))
    )
    expected = START + np.tanh(np.concatenate([START, [0.1, 0.2, 0.3]])).sum()
    np.testing.assert_allclose(two.set_point(START, np.array([0.1, 0.2, 0.3])), expected)


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (
            lambda n: replace(n, out_mean=np.full(DOF, 9.0)),
            "OUT_OF_LIMITS",
            "leaves the limits: joint 4 would be at",
        ),
        (
            lambda n: replace(n, layers=((np.full((DOF + 3, DOF), 1e308), np.zeros(DOF)),) * 1),
            "NOT_FINITE",
            "joint 1",
        ),
    ],
    ids=["out of limits", "no number"],
)
def test_a_set_point_that_no_arm_may_go_to_stops_it(
    setting: Setting, monkeypatch: pytest.MonkeyPatch, change: Any, code: str, words: str
) -> None:
    wrong, good = change(network()), network()
    asked: list[int] = []

    def decide(_self: PolicyNetwork, q: np.ndarray, goal: np.ndarray) -> np.ndarray:
        asked.append(1)
        with np.errstate(all="ignore"):
            return set_point(good if len(asked) < 8 else wrong, q, goal)

    set_point = PolicyNetwork.set_point
    monkeypatch.setattr(PolicyNetwork, "set_point", decide)
    outcome = setting.drive()
    assert outcome.reason.code == code
    assert words in outcome.reason.message
    assert setting.arm.settled()
    assert np.abs(setting.arm.q - START).max() > 0.05  # it moved, and came to rest
    setting.within_limits()


def test_old_joints_decide_nothing(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = setting.arm.state

    def old() -> ArmState:
        return replace(whole(), stamp=whole().stamp - 0.2)

    def lost() -> ArmState:
        raise DeviceLost("arm", "does not answer")

    for state, words in ((old, "the joints are 200 ms old"), (lost, "arm: does not answer")):
        monkeypatch.setattr(setting.arm, "state", state)
        outcome = setting.drive()
        assert outcome.reason.code == "STALE_JOINTS"
        assert words in outcome.reason.message


def test_a_policy_that_goes_to_and_fro_ends_in_time(setting: Setting) -> None:
    W = np.zeros((DOF + 3, DOF))
    W[0, 0] = -1.0  # far beyond the middle, again and again
    write_policy(setting.file, network(layers=((W, END),)))
    outcome = setting.drive(patience=1.0)
    assert outcome.reason.code in ("TIMEOUT", "OUT_OF_LIMITS")
    write_policy(setting.file, network(rate=1.0))
    outcome = setting.drive(patience=1.0, watchdog=2.0)
    assert outcome.reason.code == "TIMEOUT"


def test_without_decisions_in_time_the_arm_comes_to_rest(setting: Setting) -> None:
    write_policy(
        setting.file, network(rate=2.0)
    )  # asked twice a second, and the watchdog waits 100 ms
    outcome = setting.drive(watchdog=0.1)
    assert outcome.reason.code == "MOTION_FAILED"
    assert "no new set-point came for 100 ms" in outcome.reason.message
    setting.within_limits()


def test_a_stop_by_another_client_is_reported_and_a_refusal_too(setting: Setting) -> None:
    outcome = setting.drive(
        lambda tick: setting.arm.safe_stop("somebody pressed stop") if tick == 20 else None
    )
    assert outcome.reason.code == "STOPPED"
    outcome = setting.drive()
    assert outcome.reason.code == "REFUSED"
    assert "somebody pressed stop" in outcome.reason.message


def test_paused_it_rests_and_goes_on(setting: Setting) -> None:
    rested: list[np.ndarray] = []

    def each_tick(tick: int) -> None:
        if tick == 20:
            setting.arm.pause()
        elif tick == 100:
            rested.append(setting.arm.q.copy())
        elif tick == 200:
            assert np.array_equal(setting.arm.q, rested[0])
            setting.arm.resume()

    assert setting.drive(each_tick).status is Status.SUCCESS
    np.testing.assert_allclose(setting.arm.q, END, atol=np.radians(1.6))
    setting.within_limits()


def test_interrupted_it_comes_to_rest(setting: Setting) -> None:
    outcome = setting.drive(interrupt_after=25)
    assert outcome.status is Status.INVALID
    assert setting.arm.settled()
    assert 0.02 < np.abs(setting.arm.q - START).max() < 0.45
    setting.within_limits()


def damaged(file: Path, content: bytes) -> None:
    file.write_bytes(content)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: f.unlink(), "No such file"),
        (lambda f: f.write_bytes(b""), "no archive of NumPy"),
        (lambda f: f.write_text("hello"), "no archive of NumPy"),
        (lambda f: f.write_bytes(f.read_bytes()[:-40]), "no archive of NumPy"),
        (lambda f: np.savez(f, a=np.zeros(3)), "has no format pomona-policy-1"),
        (lambda f: np.savez(f, format=np.array([object()], object)), "no archive of NumPy"),
        (lambda f: np.savez(f, format="pomona-policy-1"), "is incomplete"),
        (lambda f: write_policy(f, network(rate=0.0)), "a rate of 0 Hz is not possible"),
        (lambda f: write_policy(f, network(layers=())), "its last layer gives 0 numbers for 7 joints"),
        (lambda f: write_policy(f, network(layers=((np.zeros((3, 7)), np.zeros(7)),))), "layer 0 does not fit"),
        (lambda f: write_policy(f, network(in_mean=np.zeros(3))), "'in_mean' must be 10 numbers"),
        (lambda f: write_policy(f, network(out_mean=np.full(DOF, np.nan))), "holds a value that is not finite"),
        (lambda f: write_policy(f, network(in_scale=np.zeros(DOF + 3))), "a scale that is not positive"),
    ],
    ids=[
        "gone", "empty", "text", "cut", "another archive", "objects", "parts missing", "rate", "no layers", "layers",
        "scales", "nan", "zero scale",
    ],
)  # fmt: skip
def test_a_file_that_holds_no_policy_moves_nothing(
    setting: Setting, spoil: Any, words: str
) -> None:
    spoil(setting.file)
    outcome = setting.drive()
    assert outcome.reason.code == "BAD_WEIGHTS"
    assert words in outcome.reason.message
    assert "nothing has moved" in outcome.reason.message
    assert np.array_equal(setting.arm.q, START)


def test_a_policy_of_another_arm_or_of_any_size_is_refused(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    six = (np.zeros(9), np.ones(9), np.zeros(6), np.ones(6))
    write_policy(
        setting.file,
        PolicyNetwork(JOINTS[:6], 10.0, *six, layers=((np.zeros((9, 6)), np.zeros(6)),)),
    )
    outcome = setting.drive()
    assert outcome.reason.code == "BAD_WEIGHTS"
    assert "moves 6 joints, the arm has 7" in outcome.reason.message
    monkeypatch.setattr(policy_network, "MOST_BYTES", 1 << 9)
    with pytest.raises(UnusablePolicy, match=r"unpacks to .* are read at most: no policy"):
        read_policy(setting.file)
