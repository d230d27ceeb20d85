"""The example of a learned policy: its package moves the arm within its limits, or gives the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper, save
from py_trees.common import Status

from pomona.drivers import Arm, DeviceLost, StreamedArm
from pomona.executive import SkillEnd, drive
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.hand import PERIOD
from tests.strangers.installed import HERE, pomona

EXAMPLE = HERE.parents[1] / "examples" / "policy"
DOF = 7
START = np.array([-1.3, -0.3, -0.2, -0.2, 0.1, -1.2, 0.0])
END = START + np.array([0.4, -0.2, 0.1, 0.3, -0.2, 0.1, 0.5])


def network(
    path: Path, end: np.ndarray = END, gain: float = 1.0 / 3.0, inputs: int = DOF + 3
) -> Path:
    """A policy that goes this part of the way to `end`, wherever the goal is."""
    dof = len(end)
    W = np.zeros((inputs, dof), np.float32)
    W[:dof] = (1.0 - gain) * np.eye(dof)
    given = helper.make_tensor_value_info("state", TensorProto.FLOAT, [1, inputs])
    made = helper.make_tensor_value_info("target", TensorProto.FLOAT, [1, dof])
    b = (gain * end).astype(np.float32)
    parts = [numpy_helper.from_array(W, "W"), numpy_helper.from_array(b, "b")]
    node = helper.make_node("Gemm", ["state", "W", "b"], ["target"])
    model = helper.make_model(
        helper.make_graph([node], "g", [given], [made], parts),
        opset_imports=[helper.make_opsetid("", 18)],
    )
    model.ir_version = 10
    save(model, path)
    return path


class Setting:
    def __init__(self, folder: Path, skill: type) -> None:
        self.clock, self.skill = MockClock(), skill
        self.arm = MockArm(self.clock, START)
        self.file = network(folder / "policy.onnx")
        self.passed: list[np.ndarray] = []
        self.clock.each_step.append(lambda: self.passed.append(self.arm.q.copy()))

    def drive(self, each_tick: Callable[[int], None] | None = None, **given: Any) -> SkillEnd:
        how = {key: given.pop(key) for key in ("interrupt_after",) if key in given}
        inputs = {"network": str(self.file), "x": 0.1, "y": -0.4, "z": 0.1, **given}
        devices = {Arm: self.arm, StreamedArm: self.arm}
        return drive(self.skill(), inputs, devices, clock=self.clock, each_tick=each_tick, **how)

    def assert_within_limits_and_at_rest(self) -> None:
        for k, limit in ((1, self.arm.limits.velocity), (2, self.arm.limits.acceleration)):
            rate = np.diff(np.array(self.passed), k, axis=0) / PERIOD**k
            assert (np.abs(rate).max(axis=0) <= 1.01 * limit + 1e-6).all()
        assert self.arm.settled()


@pytest.fixture
def setting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Setting:
    monkeypatch.syspath_prepend(str(EXAMPLE))
    return Setting(tmp_path, import_module("policy").Policy)


def test_it_goes_where_the_policy_wants_and_ends_when_it_wants_no_more(setting: Setting) -> None:
    assert setting.drive().status is Status.SUCCESS
    np.testing.assert_allclose(setting.arm.q, END, atol=np.radians(1.6))
    setting.assert_within_limits_and_at_rest()


def test_interrupted_it_comes_to_rest_and_paused_it_goes_on(setting: Setting) -> None:
    assert setting.drive(interrupt_after=25).status is Status.INVALID
    assert 0.02 < np.abs(setting.arm.q - START).max() < 0.45
    setting.assert_within_limits_and_at_rest()
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


@pytest.mark.parametrize(
    ("end", "code", "words"),
    [
        (np.full(DOF, 90.0), "OUT_OF_LIMITS", "the policy's set-point: joint"),
        (np.full(DOF, np.nan), "BAD_NETWORK", "expected 7 numbers"),
        (np.zeros(6), "BAD_NETWORK", "expected 7 numbers"),
    ],
    ids=["out of limits", "no number", "another arm"],
)
def test_a_set_point_that_no_arm_may_go_to_stops_it(
    setting: Setting, end: np.ndarray, code: str, words: str
) -> None:
    network(setting.file, end, 1.0)
    outcome = setting.drive()
    assert outcome.reason.code == code
    assert words in outcome.reason.message
    setting.assert_within_limits_and_at_rest()


def test_it_ends_in_time_and_on_a_stop_by_another_client(setting: Setting) -> None:
    network(setting.file, gain=0.02)  # it never comes near enough in a second
    assert setting.drive(patience=1.0).reason.code == "TIMEOUT"
    setting.assert_within_limits_and_at_rest()
    network(setting.file)
    outcome = setting.drive(
        lambda tick: setting.arm.safe_stop("somebody pressed stop") if tick == 20 else None
    )
    assert outcome.reason.code == "MOTION_FAILED"
    outcome = setting.drive()
    assert outcome.reason.code == "REFUSED"
    assert "somebody pressed stop" in outcome.reason.message


def test_old_joints_decide_nothing(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh = setting.arm.state

    def lost() -> Any:
        raise DeviceLost("arm", "does not answer")

    def old() -> Any:
        return replace(fresh(), stamp=fresh().stamp - 0.2)

    for state, words in ((old, "the joints are 200 ms old"), (lost, "arm: does not answer")):
        monkeypatch.setattr(setting.arm, "state", state)
        outcome = setting.drive()
        assert outcome.reason.code == "STALE_JOINTS"
        assert words in outcome.reason.message
    assert np.array_equal(setting.arm.q, START)


def test_a_file_that_holds_no_network_moves_nothing(setting: Setting) -> None:
    for spoil in (lambda: setting.file.write_text("hello"), setting.file.unlink):
        spoil()
        outcome = setting.drive()
        assert outcome.reason.code == "BAD_NETWORK"
        assert "nothing has moved" in outcome.reason.message
        assert "\n" not in outcome.reason.message
    network(setting.file, inputs=DOF + 5)
    assert "fails on 10 values" in setting.drive().reason.message
    assert np.array_equal(setting.arm.q, START)


TREE = """pomona: 1
tree: reach
root:
  Policy: {{network: {file}, x: 10 cm, y: -40 cm, z: 10 cm}}
"""


@pytest.mark.slow
def test_it_is_found_beside_pomona_and_runs_in_a_tree(tmp_path: Path) -> None:
    file = network(tmp_path / "policy.onnx", np.zeros(DOF))
    (tmp_path / "reach.yaml").write_text(TREE.format(file=file))
    pomona("new", "cell", "bench", package=EXAMPLE, folder=tmp_path)
    done = pomona("run", "reach.yaml", "--cell", "bench.yaml", package=EXAMPLE, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "✓ reach  succeeded" in done.stdout
