import pytest

from pomona.drivers.interfaces import MotionState
from pomona.executive.skill import Interrupted
from pomona.skills.shared.following import MotionEnded, follow_motion


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


def test_what_the_watch_raises_stops_the_motion_first():
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
