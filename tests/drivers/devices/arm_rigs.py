"""Every arm driver behind one interface, with the set-points that its controller plays: for tests that hold for all.

A new driver gets these tests by a class here and a line in `RIGS`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.executive.cell.connect import load_cell
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.arm import SIA5F_LIMITS
from tests.drivers.tools.simulation.conftest import SIM, rest_to_rest

Says = Callable[[np.ndarray], np.ndarray]


class Rig:
    """An arm, and the set-points that its controller has played.

    Attributes:
        arm: the driver; limits: of its joints.
        period: between two set-points [s].
        played: set-points, (dof,) [rad] each; those after a stop of the controller's own are not the driver's.
        stamps: whether its messages carry the time of the host's clock.
        holds_up: whether its controller goes on while the driver's process stands still.
        shares: largest speed, acceleration and jerk of the set-points, as shares of the limits.
    """

    arm: Any
    limits: ArmLimits
    period: float
    stamps = holds_up = False
    shares = (1.01, 1.1, 1.2)

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.played: list[np.ndarray] = []

    @property
    def q(self) -> np.ndarray:
        """Where the arm truly is, (dof,) [rad]."""
        raise NotImplementedError

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let time pass."""
        raise NotImplementedError

    def lie(self, says: Says) -> None:
        """Report the joints that `says` makes of the true ones."""
        raise NotImplementedError

    def step_clocks(self, host: float, controller: float) -> None:
        """Step the clocks of the two computers [s]."""

    def hold_up(self, seconds: float) -> None:
        """Let the driver's process stand still; only the controller goes on."""

    def path(self) -> Trajectory:
        """Return a motion from where the arm is, that comes near to the limits of some joints."""
        raise NotImplementedError

    def foreign(self) -> None:
        """Another master gives a set-point 0.05 rad away."""
        pytest.skip("has no other master")

    def slow_down(self, rate: float) -> None:
        """Let the controller's time pass at this rate of the host's from now on."""
        pytest.skip("has no time of its own")

    def to(self, change: np.ndarray) -> Trajectory:
        """Return the motion that changes the joints by this, (dof,) [rad]."""
        return rest_to_rest(np.array([self.q, self.q + change]), self.limits, 0.8)

    def stop_noting(self) -> None:
        """What follows is the controller's own."""
        self.played = _Closed(self.played)

    def worst(self) -> tuple[float, float, float]:
        """Largest speed, acceleration and jerk of the set-points, as shares of the limits."""
        q = np.array(self.played)
        shares = []
        for limit in (self.limits.velocity, self.limits.acceleration, self.limits.jerk):
            q = np.diff(q, axis=0) / self.period
            shares.append(float((np.abs(q) / limit).max()))
        return shares[0], shares[1], shares[2]


class _Closed(list[np.ndarray]):
    def append(self, _q: np.ndarray) -> None:
        """Nothing more is noted."""


class MockRig(Rig):
    """The mock arm."""

    limits, period = SIA5F_LIMITS, 0.002

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(monkeypatch)
        self.clock = MockClock()
        self.arm = MockArm(self.clock)
        self.clock.each_step.append(lambda: self.played.append(self.arm.q.copy()))

    @property
    def q(self) -> np.ndarray:
        return self.arm.q.copy()

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while self.clock.now() < end and not until():
            self.clock.advance(self.period)

    def lie(self, says: Says) -> None:
        self.arm.says = says

    def path(self) -> Trajectory:
        return rest_to_rest(
            np.array([self.q, self.q + np.array([0.8, -0.5, 0.3, 0.3, 0.4, 0.5, -0.9])]),
            self.limits,
            0.8,
        )


class SimRig(Rig):
    """The simulated arm."""

    period = 0.002

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__(monkeypatch)
        self.cell = load_cell(SIM, seed=1, overrides={"distractors": "0"})
        self.arm = self.cell.devices["arm"]
        self.limits = self.arm.limits
        self.arm._world.before_step.append(lambda: self.played.append(self.arm._set_point.copy()))

    @property
    def q(self) -> np.ndarray:
        return self.arm._measure().q

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.cell.clock.now() + seconds
        while self.cell.clock.now() < end and not until():
            self.cell.clock.advance(self.period)

    def lie(self, says: Says) -> None:
        said = self.arm._said

        def wrongly() -> tuple[np.ndarray, np.ndarray]:
            q, qd = said()
            return says(q), qd

        self.arm._said = wrongly

    def path(self) -> Trajectory:
        return self.to(np.array([0.8, 0.3, -0.2, 0.3, 0.4, 0.5, -0.9]))


class EmulatedRig(Rig):
    """A driver against an emulated controller on `FreeJoints`.

    Attributes:
        late: name of a wire, and by how much later it brings what the controller sends [s].
    """

    cell: Any
    holds_up = True
    late: tuple[str, float] = ("", 0.0)

    @property
    def q(self) -> np.ndarray:
        return self.cell.joints.measured()[0]

    def slow_down(self, rate: float) -> None:
        self.cell.controller.clock.rate = rate

    def delay(self) -> None:
        """Let the wire be late; called before the connection."""
        name, seconds = self.late
        opened = self.cell.open

        def open_late(port: Any) -> Any:
            connection = opened(port)
            if name and port in (name, getattr(self.cell.controller, name)):
                connection.late = seconds
            return connection

        self.cell.open = open_late


class MotomanRig(EmulatedRig):
    """The driver of MotoROS against the emulated controller."""

    period = 0.001
    shares = (1.01, 1.1, 3.0)  # cubics between points that are up to 20 ms apart

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from tests.drivers.devices.motoman import test_driver

        super().__init__(monkeypatch)
        self.cell = test_driver.Cell()
        self.limits = test_driver.LIMITS
        self.delay()
        self.arm = test_driver.connected(self.cell)
        self._serve = test_driver.serve
        self._measured = self.cell.controller._measured
        halt = self.cell.controller._halt
        advance = self.cell.clock.advance

        def advanced(seconds: float) -> None:
            self.played.append(self.q)
            advance(seconds)

        def halted() -> None:
            self.stop_noting()  # it brakes by itself
            halt()

        self.cell.clock.advance = advanced  # type: ignore[method-assign]
        self.cell.controller._halt = halted  # type: ignore[method-assign]

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        self._serve(self.arm, self.cell, seconds, until)

    def lie(self, says: Says) -> None:
        def wrongly() -> tuple[np.ndarray, np.ndarray]:
            q, qd = self._measured()
            return says(q), qd

        self.cell.controller._measured = wrongly  # type: ignore[method-assign]

    def hold_up(self, seconds: float) -> None:
        gaps, played = self.cell.controller.gaps, [*self.played]
        self.cell.let_pass(seconds)
        if self.cell.controller.gaps > gaps:  # it ran out of points, and stopped by itself
            self.played = _Closed(played)

    def path(self) -> Trajectory:
        return rest_to_rest(
            np.array([self.q, self.q + np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6, -0.7])]),
            self.limits,
            0.8,
        )


class UrRig(EmulatedRig):
    """The driver of Universal Robots against the emulated controller, which executes its script."""

    period = 0.002
    shares = (1.01, 1.1, 3.0)  # of cubics between knots 20 ms apart

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from tests.drivers.devices.universal_robots import test_driver

        super().__init__(monkeypatch)
        self.cell = test_driver.Cell()
        self.limits = test_driver.LIMITS
        controller = self.cell.controller
        servo, end_program, self._measured = (
            controller.servo,
            controller.end_program,
            controller.measured,
        )

        def served(q: np.ndarray, lookahead: float) -> None:
            self.played.append(q)
            servo(q, lookahead)

        def ended() -> None:
            self.stop_noting()  # it brakes by itself
            end_program()

        controller.servo = served  # type: ignore[method-assign]
        self.delay()
        self.arm = test_driver.connected(self.cell)
        controller.end_program = ended  # type: ignore[method-assign]
        self._serve = test_driver.serve

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        self._serve(self.arm, self.cell, seconds, until)

    def lie(self, says: Says) -> None:
        def wrongly() -> tuple[np.ndarray, np.ndarray]:
            q, qd = self._measured()
            return says(q), qd

        self.cell.controller.measured = wrongly  # type: ignore[method-assign]

    def hold_up(self, seconds: float) -> None:
        self.cell.let_pass(seconds)

    def foreign(self) -> None:
        self.cell.controller.inject_fault("replaced")

    def path(self) -> Trajectory:
        return self.to(np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6]))


class XArmRig(EmulatedRig):
    """The driver of UFACTORY arms against the emulated controller, in servo mode."""

    period = 0.004

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from tests.drivers.devices.xarm import test_driver

        super().__init__(monkeypatch)
        self.cell = test_driver.Cell()
        self.limits = test_driver.limits(6)
        controller = self.cell.controller
        self._measured, answer = controller.measured, controller.answer

        def answered(register: int, body: bytes) -> bytes:
            if register == 29:
                self.played.append(np.array(struct.unpack_from("<6f", body), np.float64))
            elif register == 12 and body[0] == 4:
                self.stop_noting()  # it brakes by itself
            return answer(register, body)

        self.delay()
        self.arm = test_driver.connected(self.cell)
        controller.answer = answered  # type: ignore[method-assign]
        self._serve = test_driver.serve

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        self._serve(self.arm, self.cell, seconds, until)

    def lie(self, says: Says) -> None:
        def wrongly() -> tuple[np.ndarray, np.ndarray]:
            q, qd = self._measured()
            return says(q), qd

        self.cell.controller.measured = wrongly  # type: ignore[method-assign]

    def hold_up(self, seconds: float) -> None:
        self.cell.let_pass(seconds)

    def foreign(self) -> None:
        there = struct.pack("<7f", *(self.q + 0.05), 0.0)
        self.cell.controller.answer(29, there + bytes(12))

    def path(self) -> Trajectory:
        return self.to(np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6]))


class Ros2Rig(Rig):
    """The driver of ROS 2 against a joint_trajectory_controller."""

    stamps = holds_up = True
    shares = (1.01, 1.1, 6.0)  # of cubics between points 10 ms apart, and 50 ms to a stop

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
        pytest.importorskip("zenoh", reason="the extra ros2 is not installed")
        from tests.drivers.devices.ros2 import test_ros2_arm

        super().__init__(monkeypatch)
        monkeypatch.setattr(test_ros2_arm.module, "PATIENCE", 0.0)
        self.setting = test_ros2_arm.Setting()
        self.arm, self.limits, self.period = (
            self.setting.arm,
            test_ros2_arm.LIMITS,
            test_ros2_arm.STEP,
        )
        self.controller = self.setting.controller
        advance = self.controller.advance

        def advanced(seconds: float) -> None:
            advance(seconds)
            self.played.append(self.q)

        self.controller.advance = advanced  # type: ignore[method-assign]

    @property
    def q(self) -> np.ndarray:
        return np.array(self.controller.q)

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        self.setting.serve(seconds, until)

    def lie(self, says: Says) -> None:
        self.controller.says = says

    def step_clocks(self, host: float, controller: float) -> None:
        self.setting.host_step += host
        self.controller.clock_step += controller

    def hold_up(self, seconds: float) -> None:
        for _ in range(round(seconds / self.period)):
            self.controller.advance(self.period)

    def foreign(self) -> None:
        from tests.drivers.devices.ros2 import test_ros2_arm as of

        there = self.q + 0.05
        point = {
            "positions": there,
            "velocities": 0.0 * there,
            "time_from_start": of.stamped(0.2),
        }
        header = {"stamp": of.stamped(0.0), "frame_id": ""}
        fields = {"header": header, "joint_names": list(of.JOINTS), "points": [point]}
        message = of.coder(of.TRAJECTORY).coded(fields)
        self.controller.publish(self.arm.options.commands, of.TRAJECTORY, message, 0)

    def path(self) -> Trajectory:
        return self.to(np.array([0.8, -0.6, 0.3]))


RIGS: dict[str, type[Rig]] = {
    "mock": MockRig,
    "sim": SimRig,
    "motoman": MotomanRig,
    "universal-robots": UrRig,
    "xarm": XArmRig,
    "ros2": Ros2Rig,
}
