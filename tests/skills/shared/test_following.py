import numpy as np
import pytest

from pomona.drivers.interfaces import Arm, Camera, Hand, MotionState
from pomona.executive.errors import SkillError
from pomona.executive.skill import Interrupted, Work
from pomona.executive.skill_testing import drive
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.shared.following import MOTION_FAILURES, MotionEnded, MovingSkill, follow_motion
from pomona.skills.shared.live_watch import KnownAround
from tests.skills.overhead import watched
from tests.skills.picking_scene import HOME, OBSERVE, PickingScene


class ScriptedMotion:
    """Runs for some looks, then ends; takes two looks to settle after a stop."""

    problem = ""

    def __init__(self, looks: int, end: MotionState = MotionState.DONE, problem: str = "") -> None:
        self._left, self._end, self._settling = looks, end, 2
        self.problem = problem
        self.stopped = False

    @property
    def state(self) -> MotionState:
        if self.stopped:
            return MotionState.STOPPED
        self._left -= 1
        return MotionState.RUNNING if self._left >= 0 else self._end

    @property
    def progress(self) -> float:
        return 0.5

    @property
    def settled(self) -> bool:
        if not self.stopped:
            return True
        self._settling -= 1
        return self._settling < 0

    def stop(self) -> None:
        self.stopped = True


def test_it_ends_when_the_motion_is_done():
    motion = ScriptedMotion(4)
    assert "50%" in list(follow_motion(motion))
    assert not motion.stopped


@pytest.mark.parametrize("end", [MotionState.STOPPED, MotionState.FAILED])
def test_an_early_end_is_raised_with_the_motions_own_words(end):
    with pytest.raises(MotionEnded, match="belt slipped") as ended:
        list(follow_motion(ScriptedMotion(2, end, "the belt slipped")))
    assert ended.value.state is end


def test_interrupted_it_stops_the_motion_and_passes_once_all_is_at_rest():
    motion = ScriptedMotion(100)
    following = follow_motion(motion)
    next(following)
    assert following.throw(Interrupted()) == "stopping"
    assert motion.stopped
    assert next(following) == "stopping"
    with pytest.raises(Interrupted):
        next(following)


def test_an_exception_of_the_watch_stops_the_motion_first():
    class Felt(Exception):
        pass

    def watch() -> None:
        raise Felt

    motion = ScriptedMotion(100)
    with pytest.raises(Felt):
        list(follow_motion(motion, watch))
    assert motion.stopped


def test_thrown_away_it_still_stops_the_motion():
    motion = ScriptedMotion(100)
    following = follow_motion(motion)
    next(following)
    following.close()
    assert motion.stopped


class WatchedTravel(MovingSkill):
    """Travels along a watched path and reports its own progress."""

    devices = (Arm,)
    failures = MOTION_FAILURES

    def run(self) -> Work[None]:
        path = time_polyline(np.array([OBSERVE, HOME]), self.device(Arm).limits)
        yield from self.travel(path, lambda: "no contact", around=KnownAround())
        return None


def test_a_watched_path_keeps_the_feedback_of_its_skill():
    scene, skill = PickingScene(), WatchedTravel()
    devices, camera = watched(scene)
    messages: list[str] = []
    outcome = drive(
        skill,
        {},
        devices,
        clock=scene.clock,
        each_tick=lambda _tick: messages.append(skill.feedback_message),
    )
    assert outcome.reason is None
    assert camera.frames > 3
    assert any(message.endswith("%, no contact") for message in messages)


def test_only_declared_devices_can_be_used():
    scene, skill = PickingScene(), WatchedTravel()
    drive(skill, {}, scene.devices, clock=scene.clock)
    assert skill.optional_device(Arm) is not None
    with pytest.raises(SkillError, match="Hand, which is not in its `optional_devices`"):
        skill.optional_device(Hand)
    with pytest.raises(SkillError, match="Camera, which is not in its `devices`"):
        skill.device(Camera)
