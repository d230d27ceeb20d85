"""Grippers that know positions alone: set-points that advance before the fingers, by a bounded way."""

from __future__ import annotations

import pytest

from pomona.drivers.base.parallel_gripper import SpeedOrder, Stop, Wanted, WidthOrder
from pomona.drivers.base.position_gripper import LONGEST, SPEED_WINDOW, PositionGripper
from pomona.drivers.interfaces import GripperLimits, GripperState, MotionState
from pomona.executive.clock import ManualClock

STEP = 0.01


class Steps(PositionGripper[GripperState, float]):
    """Fingers that are at their set-point at once, unless something holds them."""

    def __init__(self) -> None:
        limits = GripperLimits(0.01, 0.09, 0.1, 20.0)
        super().__init__("gripper", ManualClock(5.0), limits, acceleration=10.0, watchdog=0.1)
        self.width = 0.05
        self.least, self.most = 0.0, 1.0
        self.told: list[float] = []

    def _ahead(self, speed: float) -> float:
        return 0.001 + 0.02 * speed

    def _serve(self) -> None:
        self._clock.advance(STEP)
        now = self._clock.now()
        self._measured(now, self.width, self._rate(now, self.width))
        self._status = self._state

    def next_command(self, wanted: Wanted, status: GripperState) -> float | None:
        if isinstance(wanted, Stop):
            return status.width
        return self._set_point

    def _send(self, command: float) -> None:
        self.told.append(command)
        self.width = min(max(command, self.least), self.most)


@pytest.fixture
def gripper() -> Steps:
    found = Steps()
    found.connect()
    for _ in range(10):
        found.step()
    return found


@pytest.mark.parametrize(
    ("wanted", "last", "elapsed", "expected"),
    [
        (WidthOrder(0.06, 0.1, 5.0), None, 0.01, 0.051),  # 1 mm on, from the fingers' place
        (WidthOrder(0.04, 0.1, 5.0), None, 0.01, 0.049),
        (WidthOrder(0.06, 0.1, 5.0), 0.052, 0.005, 0.0525),  # from the last set-point
        (WidthOrder(0.0505, 0.1, 5.0), None, 0.01, 0.0505),  # no further than its end
        (WidthOrder(0.0495, 0.1, 5.0), None, 0.01, 0.0495),
        (WidthOrder(0.06, 0.1, 5.0), 0.0525, 0.01, 0.053),  # 3 mm before the fingers at most
        (WidthOrder(0.04, 0.1, 5.0), 0.0475, 0.01, 0.047),
        (WidthOrder(0.04, 0.1, 5.0), 0.055, 0.01, 0.054),  # one too far ahead is not drawn back
        (WidthOrder(0.06, 0.1, 5.0), 0.055, 0.01, 0.055),  # … nor led further
        (WidthOrder(0.06, 0.1, 5.0), 0.045, 0.01, 0.046),  # fingers that lead it hurry it not
        (SpeedOrder(0.05), None, 0.02, 0.051),
        (SpeedOrder(-0.05), None, 0.02, 0.049),
        (SpeedOrder(0.05), 0.052, 0.02, 0.052),  # 2 mm before the fingers at most
        (SpeedOrder(-0.05), 0.048, 0.02, 0.048),
        (SpeedOrder(0.0), 0.0505, 0.02, 0.0505),
    ],
)
def test_a_set_point_advances_by_its_speed_and_precedes_the_fingers_by_a_bounded_way(
    gripper: Steps, wanted: WidthOrder | SpeedOrder, last: float | None, elapsed: float,
    expected: float,
) -> None:  # fmt: skip
    gripper._set_point = last
    assert gripper._advanced(wanted, 0.05, elapsed) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("speed", "width", "expected"), [(0.1, 0.0895, 0.09), (-0.1, 0.0105, 0.01)]
)
def test_a_set_point_stays_within_the_stroke(
    gripper: Steps, speed: float, width: float, expected: float
) -> None:
    assert gripper._advanced(SpeedOrder(speed), width, 0.02) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("stall", "way"), [(0.005, 0.0005), (LONGEST, 0.002), (1.0, 0.002), (-1.0, 0.0)]
)
def test_a_set_point_does_not_jump_after_a_stall(gripper: Steps, stall: float, way: float) -> None:
    gripper._wanted = SpeedOrder(0.1)
    gripper._stepped_at = gripper._clock.now() - stall
    gripper._command()
    assert gripper.told[-1] == pytest.approx(0.05 + way)
    assert gripper._stepped_at == gripper._clock.now()


def test_a_move_goes_to_its_width_and_ends_there(gripper: Steps) -> None:
    motion = gripper.move(0.06, 0.1)
    for _ in range(9):
        gripper.step()
    assert gripper.width == pytest.approx(0.059)
    assert motion.state is MotionState.RUNNING
    for _ in range(10):
        gripper.step()
    assert (motion.state, motion.settled) == (MotionState.DONE, True)
    assert gripper.width == pytest.approx(0.06)
    gripper.check()


@pytest.mark.parametrize("width", [0.02, 0.08])
def test_fingers_that_something_holds_are_blocked_there(gripper: Steps, width: float) -> None:
    gripper.least, gripper.most = 0.045, 0.055
    motion = gripper.move(width, 0.05)
    for _ in range(60):
        gripper.step()
    at = "45.0" if width < 0.05 else "55.0"
    assert motion.problem == f"the fingers are blocked at {at} mm"
    assert motion.state is MotionState.FAILED


def test_a_motion_is_commanded_again_and_again_and_a_stop_until_the_fingers_rest(
    gripper: Steps,
) -> None:
    gripper.move(0.08, 0.02)
    for _ in range(20):
        gripper.step()
    assert len(gripper.told) == 20
    assert not gripper.shows(WidthOrder(0.08, 0.02, 20.0), gripper.state())
    assert not gripper.shows(Stop(), gripper.state())
    gripper.safe_stop("test")
    for _ in range(20):
        gripper.step()
    assert gripper.shows(Stop(), gripper.state())
    assert gripper.settled()
    told = len(gripper.told)
    assert 21 <= told < 40
    for _ in range(5):
        gripper.step()
        assert len(gripper.told) == told


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rate_is_the_difference_over_the_window(gripper: Steps, sign: float) -> None:
    gripper._widths = []
    found = [gripper._rate(0.01 * k, 0.05 + sign * 0.001 * k) for k in range(12)]
    assert found[:3] == [0.0, 0.0, 0.0]  # half of the window is too short
    assert found[3:] == pytest.approx([sign * 0.1] * 9)


def test_a_rate_uses_no_width_older_than_the_window_but_always_the_last(gripper: Steps) -> None:
    gripper._widths = [(-1.0, 0.01), (0.0, 0.05)]
    assert gripper._rate(SPEED_WINDOW, 0.054) == pytest.approx(0.1)
    assert gripper._rate(2.0, 0.058) == pytest.approx(0.004 / (2.0 - SPEED_WINDOW))
    gripper._widths = [(0.0, 0.05)]
    assert gripper._rate(0.5 * SPEED_WINDOW, 0.06) == 0.0  # half of the window itself
    assert gripper._widths == [(0.0, 0.05), (0.5 * SPEED_WINDOW, 0.06)]
