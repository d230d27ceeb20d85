"""The common base of arms, with a driver of a few lines: requests, sessions, losses and measured rest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import ArmLimits, MotionState, Trajectory
from pomona.drivers.motion_supervisor import STRAYS, Supervision
from pomona.drivers.path_arm import AT_REST, RECONNECT, StreamingArm
from pomona.drivers.path_motion import PathMotion
from pomona.executive.cell.owner import Link
from pomona.executive.clock import ManualClock

PERIOD = 0.01
LIMITS = ArmLimits(
    np.array([-2.0, -1.0]), np.array([2.0, 1.0]), np.array([2.0, 3.0]),
    np.array([20.0, 30.0]), np.array([500.0, 500.0]),
)  # fmt: skip


class Wire:
    """A link, and a session that fails as the test wants it."""

    def __init__(self) -> None:
        self.closed = 0
        self.close_fails = False

    def send(self, chunk: bytes) -> None:
        raise NotImplementedError

    def receive(self, timeout: float) -> bytes:
        raise NotImplementedError

    def close(self) -> None:
        self.closed += 1
        if self.close_fails:
            raise OSError("already gone")


class Points:
    """Set-points that the arm takes at once."""

    def __init__(self, q: np.ndarray) -> None:
        self.q_last, self.sent, self.played, self.due = q, 0, True, 0.0


class Bench(StreamingArm[Wire, Points]):
    """An arm that stands where its newest set-point is, beside what the test adds to it."""

    lead, lag = 0.04, 0.02

    def __init__(self) -> None:
        super().__init__("arm", ManualClock(10.0), Path("none.urdf"), LIMITS, Supervision(), PERIOD)
        self.q, self.beside, self.qd = np.zeros(2), np.zeros(2), np.zeros(2)
        self.error: Exception | None = None
        self.not_open: Exception | None = None
        self.not_ready: Exception | None = None
        self.opened: list[Wire] = []
        self.calls: list[str] = []
        self.halted: list[str] = []
        self._open_port = self._new_wire
        self._points: Points | None = None
        self._moved: Any = None

    def _new_wire(self, name: str) -> Link:
        self.opened.append(Wire())
        return self.opened[-1]

    def _open(self, open_link: Callable[[str], Link]) -> Wire:
        wire: Any = open_link("main")
        if self.not_open is not None:
            raise self.not_open
        self._believe(self._clock.now(), self.q, np.zeros(2))
        return wire

    def _make_ready(self, session: Wire) -> None:
        self.calls.append("ready")
        if self.not_ready is not None:
            raise self.not_ready

    def _unlock(self, session: Wire) -> None:
        self.calls.append("unlock")

    def _serve(self, session: Wire) -> None:
        self._clock.advance(PERIOD)
        if self.error is not None:
            raise self.error
        if self._starting:
            self._start_again(session)
        if self._points is not None:
            q, _ = self._moved.step()
            self._points.q_last, self._points.due = q, self._clock.now() + self.lead
            self._points.sent += 1
            self._supervisor.command(self._clock.now(), q)
            self.q = q
        try:
            self._believe(self._clock.now(), self.q + self.beside, self.qd)
        except DeviceLost as error:
            self._doubt(error)
        self._watch_motion()

    def _begin_stream(self, motion: Any, q_arm: np.ndarray) -> None:
        self._moved, self._points = motion, Points(q_arm)

    def _halt(self, problem: str) -> None:
        self.halted.append(problem)
        self._abandon(problem)


@pytest.fixture
def arm() -> Bench:
    found = Bench()
    found.connect()
    return found


def path(duration: float = 0.5, start: float = 0.0, way: float = 0.1) -> Trajectory:
    times = np.linspace(0.0, duration, 51)
    x = np.pi * times / duration
    rate = np.pi / duration
    columns = [
        way * (1.0 - np.cos(x)) + start,
        way * rate * np.sin(x),
        way * rate**2 * np.cos(x),
    ]
    return Trajectory(times, *(np.column_stack([c, np.zeros_like(c)]) for c in columns))


def serve(arm: Bench, count: int) -> None:
    for _ in range(count):
        arm.step()


def test_an_arm_that_was_never_connected_refuses_and_says_why() -> None:
    arm = Bench()
    assert arm.link() == "was never connected"
    assert arm.last_seen() is None
    for call in (arm.check, arm.state, arm.acknowledge):
        with pytest.raises(DeviceLost, match="was never connected"):
            call()
    with pytest.raises(MotionRefused, match="was never connected"):
        arm.follow(path())
    assert arm.settled()


def test_a_connected_arm_is_made_ready_and_rests(arm: Bench) -> None:
    assert arm.calls == ["ready"]
    assert arm.link() == "ok"
    assert arm.last_seen() == 10.0
    assert arm.settled()
    assert not arm.state().moving
    arm.check()


def test_an_arm_that_cannot_be_made_ready_is_left(arm: Bench) -> None:
    other = Bench()
    other.not_ready = OSError("cut")
    with pytest.raises(DeviceLost, match=r"^arm: the connection failed: cut$"):
        other.connect()
    assert other.opened[0].closed == 1
    with pytest.raises(DeviceLost):
        other.state()


def test_links_are_closed_when_no_session_opens() -> None:
    arm = Bench()
    arm.not_open = ConnectionRefusedError("nobody listens")
    with pytest.raises(DeviceLost, match="cannot be reached: nobody listens"):
        arm.connect()
    assert [wire.closed for wire in arm.opened] == [1]
    arm.not_open = DeviceFault("arm", "is another robot")
    with pytest.raises(DeviceFault, match="is another robot"):
        arm.connect()


def test_a_path_is_followed_to_its_end(arm: Bench) -> None:
    motion = arm.follow(path())
    assert (motion.state, motion.progress, motion.settled) == (MotionState.RUNNING, 0.0, False)
    assert not arm.settled()
    serve(arm, 25)
    assert motion.progress == pytest.approx(0.5)
    assert arm.state().q[0] == pytest.approx(0.1)  # halfway, by symmetry
    assert arm.state().moving
    with pytest.raises(MotionRefused, match="still moves"):
        arm.follow(path())
    serve(arm, 25)
    assert (motion.state, motion.settled, motion.problem) == (MotionState.DONE, True, "")
    assert arm.settled()
    assert arm._stream is not None
    serve(arm, 1)
    assert arm._stream is None
    assert not arm.state().moving
    arm.follow(path(start=0.2))
    assert arm.halted == []


def test_a_path_that_starts_elsewhere_is_refused(arm: Bench) -> None:
    with pytest.raises(MotionRefused, match="the trajectory starts"):
        arm.follow(path(start=0.1))
    assert arm.settled()


@pytest.mark.parametrize(("speed", "done"), [(AT_REST, False), (0.99 * AT_REST, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arm_rests_below_a_speed(arm: Bench, speed: float, done: bool, sign: float) -> None:
    motion = arm.follow(path())
    arm.qd = np.array([0.0, sign * speed])
    serve(arm, 60)
    assert motion.settled is done
    assert arm.settled() is done


def test_a_motion_does_not_end_before_its_points_are_played(arm: Bench) -> None:
    motion = arm.follow(path())
    points: Any = arm._stream
    points.played = False
    serve(arm, 60)
    assert (motion.state, arm.settled()) == (MotionState.RUNNING, False)
    points.played = True
    serve(arm, 1)
    assert (motion.state, arm.settled()) == (MotionState.DONE, True)


def test_velocities_are_differences_where_none_are_reported(arm: Bench) -> None:
    arm._believe(10.1, np.array([0.02, -0.01]), None)
    assert arm.state().qd == pytest.approx([0.2, -0.1])


@pytest.mark.parametrize(("later", "known"), [(0.199, True), (0.2, False), (0.0, False)])
def test_positions_far_apart_in_time_give_no_velocity(
    arm: Bench, later: float, known: bool
) -> None:
    arm._state = arm.state().__class__(0.0, np.zeros(2), np.zeros(2), False)
    arm._supervisor.forget()
    arm._believe(later, np.array([0.02, 0.0]), None)
    assert bool(arm.state().qd.any()) is known


def test_the_first_joints_have_no_velocity() -> None:
    arm = Bench()
    arm._believe(3.0, np.array([0.5, 0.0]), None)
    assert arm._state is not None
    assert arm._state.qd.tolist() == [0.0, 0.0]
    assert arm.last_seen() == 3.0


def test_a_safe_stop_brakes_on_the_path_and_keeps_its_first_reason(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    arm.safe_stop("first")
    arm.safe_stop("second")
    for _ in range(40):
        serve(arm, 1)
    assert (motion.state, motion.settled) == (MotionState.STOPPED, True)
    assert 0.05 < arm.state().q[0] < 0.15
    with pytest.raises(MotionRefused, match=r"latched in the safe state \(first\)"):
        arm.follow(path(start=float(arm.q[0])))
    arm.acknowledge()
    arm.follow(path(start=float(arm.q[0])))
    assert arm.calls == ["ready"]  # nothing was lost


def test_a_pause_holds_the_arm_and_a_resume_goes_on(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    arm.pause()
    serve(arm, 40)
    assert (motion.state, motion.settled, arm.settled()) == (MotionState.PAUSED, False, True)
    assert not arm.state().moving
    stood = arm.q
    serve(arm, 10)
    assert arm.q.tolist() == stood.tolist()
    arm.resume()
    assert not arm.settled()
    serve(arm, 100)
    assert motion.state is MotionState.DONE


@pytest.mark.parametrize("call", ["pause", "resume"])
def test_without_a_motion_nothing_is_paused(arm: Bench, call: str) -> None:
    getattr(arm, call)()
    arm.go_at(0.5)
    serve(arm, 1)
    assert arm.settled()


@pytest.mark.parametrize("before", [True, False])
def test_a_speed_holds_for_present_and_next_motions(arm: Bench, before: bool) -> None:
    if before:
        arm.go_at(0.5)
    motion = arm.follow(path())
    arm.go_at(0.5)
    serve(arm, 50)
    assert motion.progress == pytest.approx(0.5, abs=0.01)
    serve(arm, 52)
    assert motion.state is MotionState.DONE


def test_a_stop_of_the_motion_is_posted(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    motion.stop()
    serve(arm, 40)
    assert motion.state is MotionState.STOPPED


def test_a_stop_between_a_request_and_its_beginning_ends_the_motion(arm: Bench) -> None:
    posted: list[Callable[[], None]] = []
    arm._owner.post = posted.append  # type: ignore[method-assign]
    motion = arm.follow(path())
    arm.safe_stop("pressed")
    posted[0]()
    assert (motion.state, motion.problem, motion.settled) == (MotionState.FAILED, "pressed", True)
    assert arm._stream is None


def test_a_motion_that_has_not_begun_waits(arm: Bench) -> None:
    posted: list[Callable[[], None]] = []
    arm._owner.post = posted.append  # type: ignore[method-assign]
    motion = arm.follow(path())
    serve(arm, 5)
    assert (motion.state, motion.settled, arm.settled()) == (MotionState.RUNNING, False, False)
    posted[0]()
    serve(arm, 51)
    assert motion.state is MotionState.DONE


def test_a_lost_session_fails_the_motion_and_is_opened_again_after_a_pause(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    arm.opened[0].close_fails = True
    arm.error = ConnectionResetError("cut")
    lost_at = arm._clock.now() + PERIOD
    serve(arm, 1)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert motion.problem == "the connection failed: cut"
    assert arm.opened[0].closed == 1
    for call in (arm.check, arm.state, arm.acknowledge):
        with pytest.raises(DeviceLost, match="the connection failed: cut"):
            call()
    arm.error = None
    while len(arm.opened) == 1:
        before = arm._clock.now()
        serve(arm, 1)
        assert arm._clock.now() - before <= 0.05 + 1e-9
    assert arm._clock.now() == pytest.approx(lost_at + RECONNECT)
    serve(arm, 1)
    with pytest.raises(MotionRefused, match="the connection failed: cut"):
        arm.follow(path(start=float(arm.q[0])))
    stood = arm.q
    arm.acknowledge()
    with pytest.raises(MotionRefused, match="it is being made ready"):
        arm.follow(path(start=float(arm.q[0])))
    arm.check()
    serve(arm, 1)
    assert arm.calls == ["ready", "unlock", "ready"]
    assert arm.q.tolist() == stood.tolist()
    assert arm.link() == "ok"
    assert arm.follow(path(start=float(arm.q[0]))).state is MotionState.RUNNING


def test_an_error_of_the_driver_itself_is_a_loss_that_names_it(arm: Bench) -> None:
    arm._failed(KeyError("joint"))
    assert arm.link() == "the driver failed: KeyError('joint')"
    serve(arm, 1)
    arm._failed(OSError("later"))
    assert arm.link() == "the driver failed: KeyError('joint')"  # the first is kept


def test_a_session_that_does_not_open_again_is_tried_again(arm: Bench) -> None:
    arm.error = OSError("cut")
    serve(arm, 1)
    arm.not_open = OSError("down")
    for attempt in range(2, 5):
        while len(arm.opened) < attempt:
            serve(arm, 1)
        at = arm._clock.now()
        assert arm._retry_at == pytest.approx(at + RECONNECT)
        assert arm.opened[-1].closed == 1
    assert arm.link() == "the connection failed: cut"


def test_an_arm_that_is_not_made_ready_after_an_acknowledgement_keeps_the_fault(arm: Bench) -> None:
    arm._blame(DeviceFault("arm", "was pressed"))
    arm.not_ready = DeviceFault("arm", "is locked")
    arm.acknowledge()
    serve(arm, 1)
    assert arm.link() == "is locked"
    with pytest.raises(MotionRefused, match="not ready: is locked"):
        arm.follow(path())


def test_implausible_feedback_brakes_the_motion_on_its_path(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    arm.beside = np.array([0.0, np.nan])
    serve(arm, 1)
    assert motion.problem.startswith("its feedback is implausible")
    with pytest.raises(DeviceLost, match="is still lost: its feedback is implausible"):
        arm.acknowledge()
    serve(arm, 40)
    assert (motion.state, motion.settled) == (MotionState.FAILED, True)
    assert 0.05 < arm.q[0] < 0.15
    assert arm.settled()
    arm.beside = np.zeros(2)
    serve(arm, 1)
    arm.acknowledge()
    serve(arm, 2)
    arm.check()


@pytest.mark.parametrize(("way", "moves"), [(0.99 * STRAYS, False), (1.01 * STRAYS, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arm_that_moves_by_itself_is_stopped(
    arm: Bench, way: float, moves: bool, sign: float
) -> None:
    serve(arm, 1)
    arm.beside = np.array([0.0, sign * way])
    serve(arm, 1)
    assert bool(arm.halted) is moves
    if moves:
        assert arm.halted[0].startswith("joint 2 moves without a command")
        with pytest.raises(DeviceFault, match="joint 2 moves without a command"):
            arm.check()


def test_an_arm_that_leaves_its_path_is_halted(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    arm.beside = np.array([0.09, 0.0])
    serve(arm, 1)
    serve(arm, 1)
    assert arm.halted != []
    assert (motion.state, motion.problem) == (MotionState.FAILED, arm.halted[0])
    assert "another program commands the arm" in arm.link()
    stood = arm.q
    serve(arm, 30)
    assert arm.q.tolist() == stood.tolist()


def test_streamed_set_points_move_the_arm(arm: Bench) -> None:
    motion = arm.stream(0.1)
    own: Any = arm._moved
    assert motion.delay == pytest.approx(own.delay + 0.06)
    assert motion.speed == 1.0
    for _ in range(60):
        motion.aim(np.array([0.1, -0.05]))
        serve(arm, 1)
    assert arm.q == pytest.approx([0.1, -0.05])
    assert own._now() == pytest.approx(arm._clock.now() + arm.lead + arm.lag)
    arm._points = None
    assert own._now() == pytest.approx(arm._clock.now() + arm.lag)


def test_a_stream_without_set_points_fails_after_its_watchdog(arm: Bench) -> None:
    arm.go_at(0.25)
    motion = arm.stream(0.1)
    assert motion.speed == 0.25
    serve(arm, 10)
    assert motion.problem == ""
    serve(arm, 1)
    assert motion.problem == "no new set-point came for 100 ms"


def test_a_closed_arm_has_come_to_rest_and_is_left(arm: Bench) -> None:
    motion = arm.follow(path())
    serve(arm, 20)
    clock, arm_step = arm._clock, arm.step

    class Served:
        """Steps the arm while somebody waits."""

        def now(self) -> float:
            return clock.now()

        def advance(self, duration: float) -> None:
            if duration == 0.02:
                arm._clock = clock
                arm_step()
                arm._clock = self  # type: ignore[assignment]

    arm._clock = Served()  # type: ignore[assignment]
    arm.close()
    assert motion.state is MotionState.STOPPED
    assert arm.opened[0].closed == 1
    assert arm.link() == "is closed"
    with pytest.raises(MotionRefused, match=r"latched in the safe state \(closed\)"):
        arm.follow(path())


def test_a_close_waits_for_rest_no_longer_than_two_seconds(arm: Bench) -> None:
    arm.follow(path())
    before = arm._clock.now()
    arm.close()
    assert 2.0 <= arm._clock.now() - before < 2.03
    assert isinstance(arm._moved, PathMotion)
