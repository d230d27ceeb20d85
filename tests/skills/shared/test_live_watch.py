"""Which frames a watched motion looks at, from which posture, and what a near obstacle does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.errors import FrameUnreadable
from pomona.drivers.interfaces import Carrier, MotionState
from pomona.skills.motion.watch import Ahead
from pomona.skills.shared import live_watch
from pomona.skills.shared.live_watch import TOO_OLD, KnownAround, LiveWatch
from tests.skills.overhead import LENS, T_BASE_CAMERA, watched
from tests.skills.picking_scene import HOME, OBSERVE, PickingScene


class Told(Exception):
    """Stands for a skill's failure."""


class RigClock:
    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def now(self) -> float:
        return self._rig.now


class Rig:
    """A watch of a motion, with cameras, a path and a clock that the test sets."""

    def __init__(self, cameras: int = 1) -> None:
        self.scene = PickingScene()
        self.now, self.looks, self.standing = 10.0, [], []
        self.ahead: Ahead | None = None
        self.frames: list[Any] = [None] * cameras
        self.views: list[Any] = []
        self.stops: list[str] = []
        self.suspected: list[Any] = []
        self.skill: Any = SimpleNamespace(
            clock=RigClock(self),
            context=self,
            optional_device={Carrier: SimpleNamespace(stop=lambda: self.stops.append("belt"))}.get,
            publish=lambda topic, view: self.views.append((topic, view)),
            failure=lambda code, message, **data: Told(code, message, data),
        )
        self.path: Any = SimpleNamespace(
            width=0.0, duration=4.0, look=self._look, standing=self._standing, slowed=self._slowed,
            suspect=self.suspected.append,
            on=lambda *given: SimpleNamespace(
                look=self._look, width=0.0, given=given, duration=given[0].duration
            ),
        )  # fmt: skip
        self.slower: Any = None
        self.eyes = tuple(
            SimpleNamespace(latest=lambda k=k: self._frame(k)) for k in range(cameras)
        )
        self.watch = LiveWatch(
            self.skill, self.scene.arm, self.eyes, self.scene.workspace, self.path  # type: ignore[arg-type]
        )  # fmt: skip
        self.motion: Any = SimpleNamespace(
            state=MotionState.RUNNING, progress=0.25, stop=lambda: self.stops.append("arm")
        )

    def _frame(self, number: int) -> Any:
        found = self.frames[number]
        if isinstance(found, Exception):
            raise found
        return found

    def _look(self, *given: Any) -> Ahead | None:
        self.looks.append(given)
        return self.ahead

    def _standing(self, *given: Any) -> Any:
        self.standing.append(given)
        return np.full((1, 3), float(given[-1]))

    def _slowed(self, points: Any, oldest: float) -> Any:
        self.points, self.oldest = points, oldest
        return self.slower


def seen(stamp: float, **changed: Any) -> Any:
    """A frame of a fixed camera."""
    given = {
        "stamp": stamp, "depth": np.ones((2, 2)), "placed": True, "q": None,
        "T_mount_camera": T_BASE_CAMERA, "label": "above", "intrinsics": LENS,
    }  # fmt: skip
    return SimpleNamespace(**(given | changed))


AHEAD = Ahead(False, False, 0.042, 0.7, (0.1, -0.2, 0.3), "forearm")


def test_a_new_frame_is_looked_at_once_at_its_age_and_at_the_present_progress() -> None:
    rig = Rig(2)
    rig.watch.begin(rig.motion)
    rig.frames = [seen(9.9), seen(9.95)]
    assert rig.watch.look() is None
    assert [(look[0].stamp, look[5]) for look in rig.looks] == [(9.9, 0), (9.95, 1)]
    _, T_base_camera, q, age, seconds, _ = rig.looks[0]
    np.testing.assert_array_equal(T_base_camera, T_BASE_CAMERA)
    np.testing.assert_allclose(q, OBSERVE)
    assert age == pytest.approx(0.1)
    assert seconds == pytest.approx(1.0)
    rig.frames[1] = seen(9.99)
    rig.watch.look()
    assert [look[0].stamp for look in rig.looks] == [9.9, 9.95, 9.99]


@pytest.mark.parametrize(
    ("changed", "looks"),
    [
        ({"stamp": 10.0 - TOO_OLD + 0.01}, 1),
        ({"stamp": 10.0 - TOO_OLD - 0.01}, 0),
        ({"stamp": 10.0 + TOO_OLD - 0.01}, 1),
        ({"stamp": 10.0 + TOO_OLD + 0.01}, 0),
        ({"depth": None}, 0),
        ({"placed": False}, 0),
    ],
)
def test_frames_that_are_stale_or_without_depth_or_place_are_left_out(
    changed: dict[str, Any], looks: int
) -> None:
    rig = Rig()
    rig.watch.begin(rig.motion)
    rig.frames = [seen(**({"stamp": 9.9} | changed))]
    rig.watch.look()
    assert len(rig.looks) == looks
    assert all(look[3] >= 0.0 for look in rig.looks)  # an age is never negative
    rig.watch.slowed()
    assert len(rig.standing) == looks


def test_an_unreadable_frame_is_none() -> None:
    rig = Rig()
    rig.watch.begin(rig.motion)
    rig.frames = [FrameUnreadable("camera", "damaged")]
    assert rig.watch.look() is None
    assert rig.watch.slowed() is None
    assert rig.looks == []


@pytest.mark.parametrize("state", [MotionState.PAUSED, MotionState.DONE, MotionState.STOPPED])
def test_only_a_motion_that_runs_is_watched(state: MotionState) -> None:
    rig = Rig()
    rig.frames = [seen(9.9)]
    rig.motion.state = state
    rig.watch.begin(rig.motion)
    assert rig.watch.look() is None
    assert rig.looks == []


def test_while_the_arm_rests_its_place_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_watch, "frame_problem", lambda *_: None)
    rig = Rig()
    rig.frames = [seen(9.9)]
    rig.watch.look()
    assert rig.looks[0][4] == 0.0
    rig.frames = [seen(9.95)]
    rig.ahead = replace(AHEAD, stop=True)
    with pytest.raises(Told):
        rig.watch.look()
    assert rig.stops == ["belt"]


def test_a_fixed_camera_sees_the_arm_where_it_was_and_one_on_the_hand_where_it_says() -> None:
    rig = Rig()
    rig.watch.begin(rig.motion)
    path = iter([(9.8, OBSERVE), (9.9, OBSERVE + 0.1), (10.0, OBSERVE + 0.4)])
    rig.watch._arm = SimpleNamespace(  # type: ignore[assignment]
        state=lambda: SimpleNamespace(stamp=(now := next(path))[0], q=now[1])
    )
    for stamp in (9.81, 9.85, 9.95):
        rig.frames = [seen(stamp)]
        rig.watch.look()
    np.testing.assert_allclose(rig.looks[-1][2], OBSERVE + 0.25)
    rig.watch._arm = rig.scene.arm
    rig.frames = [seen(9.99, q=HOME)]
    rig.watch.look()
    np.testing.assert_array_equal(rig.looks[-1][2], HOME)


def test_an_obstacle_far_ahead_is_told_and_the_motion_goes_on() -> None:
    rig = Rig()
    rig.watch.begin(rig.motion)
    rig.frames, rig.ahead = [seen(9.9)], AHEAD
    assert rig.watch.look() == "unmapped object on the path, 0.7 s ahead"
    assert rig.stops == []


@pytest.mark.parametrize("moved", [False, True])
def test_an_obstacle_that_is_near_stops_arm_and_belt_and_is_named(
    monkeypatch: pytest.MonkeyPatch, moved: bool
) -> None:
    monkeypatch.setattr(live_watch, "frame_problem", lambda *_: None)
    rig = Rig()
    rig.watch.begin(rig.motion)
    rig.frames, rig.ahead = [seen(9.9)], replace(AHEAD, stop=True, moved=moved)
    with pytest.raises(Told) as told:
        rig.watch.look()
    assert rig.stops == ["arm", "belt"]
    code, words, data = told.value.args
    assert code == "PATH_BLOCKED"
    what = "a moving object entered" if moved else "an unmapped object stands"
    assert words.startswith(f"{what} at (0.10, -0.20, 0.30) m, 42 mm from the path of forearm")
    assert data == {
        "point_m": [0.1, -0.2, 0.3], "distance_m": 0.042, "after_s": 0.7, "part": "forearm",
        "moved": moved, "camera": "above",
    }  # fmt: skip
    ((topic, view),) = rig.views
    assert topic == "blocked"
    np.testing.assert_array_equal(view.points[0].points, [[0.1, -0.2, 0.3]])


def test_objects_of_fixed_cameras_slow_the_path_and_the_oldest_look_counts() -> None:
    rig = Rig(3)
    rig.frames = [seen(9.95), seen(9.8), seen(9.99, q=HOME)]
    assert rig.watch.slowed() is None
    assert [given[-1] for given in rig.standing] == [0, 1]  # not of the camera on the hand
    assert [given[0].stamp for given in rig.standing] == [9.95, 9.8]
    np.testing.assert_array_equal(rig.points, [[0.0] * 3, [1.0] * 3])
    assert rig.oldest == pytest.approx(0.2)
    rig.slower = SimpleNamespace(duration=8.0)
    assert rig.watch.slowed() is rig.slower
    rig.watch.begin(rig.motion)
    rig.watch.look()
    assert rig.looks[-1][4] == pytest.approx(2.0)  # a quarter of the slower path


def test_a_motion_on_another_path_is_watched_on_that() -> None:
    rig = Rig()
    rig.frames = [seen(9.9)]
    along: Any = SimpleNamespace(duration=2.0)
    rig.watch.begin(rig.motion, along, "shape")  # type: ignore[arg-type]
    assert rig.watch._watch.given == (along, "shape")  # type: ignore[attr-defined]
    rig.watch.look()
    assert rig.looks[-1][4] == pytest.approx(0.5)


def test_the_pose_of_every_camera_with_a_new_frame_is_checked_before_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    checked: list[float] = []
    monkeypatch.setattr(
        live_watch, "require_sound_pose", lambda _skill, shown, *_: checked.append(shown.stamp)
    )
    rig = Rig(4)
    rig.frames = [seen(9.71), None, seen(9.69), seen(10.29)]
    rig.watch.check_cameras()
    assert checked == [9.71, 10.29]


def test_a_cell_is_watched_when_it_has_cameras_and_its_file_asks_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        live_watch,
        "PathWatch",
        lambda *args: SimpleNamespace(given=args, width=args[3], inherit=lambda *_given: None),
    )
    scene = PickingScene()
    devices, _camera = watched(scene)

    def made(**without: Any) -> LiveWatch | None:
        there = {kind: device for kind, device in devices.items() if kind.__name__ not in without}
        skill: Any = SimpleNamespace(optional_device=there.get, clock=scene.clock)
        return LiveWatch.of(skill, trajectory, KnownAround())

    still = np.zeros((3, 7))
    trajectory: Any = SimpleNamespace(
        t=np.array([0.0, 1.0, 2.5]), q=np.array([OBSERVE, OBSERVE, OBSERVE]), qd=still, qdd=still,
        duration=2.5,
    )  # fmt: skip
    watch = made()
    assert watch is not None
    assert watch._watch.given[1].duration == 2.5
    assert watch._watch.width == pytest.approx(scene.gripper.width)
    alone = made(Gripper=None)
    assert alone is not None
    assert alone._watch.width == pytest.approx(watch._robot.width_max)
    assert made(Cameras=None) is None
    assert made(Workspace=None) is None
