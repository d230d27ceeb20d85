"""The skills Track and AwaitFruit on mock devices: success, every failure code, interruption; nothing moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.conveyor.await_fruit import AwaitFruit
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.drawn_frame import camera_over, draw
from pomona.applications.conveyor.track import Track
from pomona.drivers import Arm, Camera, Cameras, Frame
from pomona.drivers.errors import FrameUnreadable
from pomona.executive import SkillEnd, drive
from pomona.skills.perception import load_fruit
from pomona.tools.mock import MockCamera
from tests.skills.applications.conveyor.belt_rig import BeltRig, the_belt


def code(end: SkillEnd) -> str:
    assert end.reason is not None
    assert len(end.reason.message) > 15
    return end.reason.code


def drawn(height: float = 0.0) -> Frame:
    """A frame of the belt, which lies higher or lower than the cell file has it [m]."""
    belt = the_belt()
    T = belt.T_base_belt.copy()
    T[2, 3] += height
    return draw(
        load_fruit("apple"), replace(belt, T_base_belt=T), camera_over(belt, 0.0), [], 0.0, 0
    )


def track(rig: BeltRig, frame: Frame | None, **inputs: object) -> SkillEnd:
    """Drive Track with a camera that always has a fresh frame."""
    if frame is not None:
        rig.camera.show(frame)
        rig.clock.each_step.append(lambda: rig.camera.show(replace(frame, stamp=rig.clock.now())))
    devices = {Camera: rig.camera, Conveyor: rig.conveyor, Arm: rig.arm}
    return drive(Track(), {"fruit": "apple", **inputs}, devices, clock=rig.clock)


def test_a_belt_that_is_seen_and_counts_gives_tracks() -> None:
    rig = BeltRig(0.15)
    end = track(rig, drawn())
    assert end.status is Status.SUCCESS, end.reason
    watch = end.outputs["tracks"]
    assert watch.tracks.encoder
    assert watch.travel.speed == pytest.approx(0.15)
    assert (
        watch.sentence == "kept up while a skill watches the belt"
    )  # shown for the port as long as the run lasts
    assert not rig.arm.followed


def test_a_belt_without_an_encoder_is_tracked_without_one() -> None:
    rig = BeltRig()
    rig.conveyor.travelled = lambda: None  # type: ignore[method-assign]
    end = track(rig, drawn())
    assert end.status is Status.SUCCESS
    assert not end.outputs["tracks"].tracks.encoder


@pytest.mark.parametrize("height", [0.08, -0.08])
def test_a_belt_elsewhere_than_in_the_cell_file_is_no_belt(height: float) -> None:
    end = track(BeltRig(), drawn(height))
    assert code(end) == "NO_BELT"
    assert "of the depth there" in end.reason.message  # type: ignore[union-attr]
    remedy = "check its `beside` and `top` there, and the pose from which the camera looks"
    assert end.reason.message.endswith(remedy)  # type: ignore[union-attr]


def test_a_camera_that_looks_away_sees_no_belt() -> None:
    frame = drawn()
    away = frame.T_mount_camera.copy()
    away[1, 3] += 3.0
    end = track(BeltRig(), replace(frame, T_mount_camera=away))
    assert code(end) == "NO_BELT"
    assert "outside the picture" in end.reason.message  # type: ignore[union-attr]


def test_an_encoder_that_counts_backwards_is_named_before_anything_moves() -> None:
    end = track(BeltRig(-0.15), drawn())
    assert code(end) == "ENCODER_FAULT"
    assert "turn its sign" in end.reason.message  # type: ignore[union-attr]


def test_an_encoder_that_is_silent_is_named() -> None:
    rig = BeltRig()
    rig.conveyor.silent_from = 0.02
    assert code(track(rig, drawn())) == "ENCODER_FAULT"


def test_a_belt_faster_than_the_arm_is_too_fast() -> None:
    end = track(BeltRig(0.7), drawn())
    assert code(end) == "BELT_TOO_FAST"
    assert code(track(BeltRig(0.2), drawn(), fastest=0.1)) == "BELT_TOO_FAST"


def test_frames_without_depth_old_ones_and_none_are_named() -> None:
    assert code(track(BeltRig(), None)) == "NO_FRAME"
    assert code(track(BeltRig(), replace(drawn(), depth=None))) == "NO_DEPTH"
    rig = BeltRig()
    rig.camera.show(replace(drawn(), stamp=-2.0))
    devices = {Camera: rig.camera, Conveyor: rig.conveyor, Arm: rig.arm}
    assert code(drive(Track(), {"fruit": "apple"}, devices, clock=rig.clock)) == "STALE_FRAME"


def test_a_fruit_that_nobody_knows_has_no_weights() -> None:
    assert code(track(BeltRig(), drawn(), fruit="durian")) == "NO_WEIGHTS"


def await_fruit(rig: BeltRig, **how: object) -> SkillEnd:
    inputs = {"tracks": rig.watch, **how.pop("inputs", {})}  # type: ignore[dict-item]
    devices = {
        Camera: rig.camera,
        Cameras: Cameras((rig.camera,)),
        Conveyor: rig.conveyor,
        Arm: rig.arm,
    }
    return drive(AwaitFruit(), inputs, devices, clock=rig.clock, **how)  # type: ignore[arg-type]


def test_the_fruit_that_will_be_gone_soonest_is_chosen_and_each_once() -> None:
    rig = BeltRig(along=-0.5)
    rig.watch.fruit[1], rig.watch.fruit[2] = (-0.3, 0.0), (0.1, 0.0)
    first = await_fruit(rig)
    assert first.outputs["target"].number == 1  # number 2 has passed
    assert first.outputs["target"].speed == pytest.approx(0.15, abs=1e-3)
    assert await_fruit(rig).outputs["target"].number == 0
    assert code(await_fruit(rig, inputs={"within": 0.5})) == "NOTHING_COMES"


@pytest.mark.parametrize(("speed", "stands"), [(0.0, True), (0.15, False)])
def test_a_belt_that_stands_is_named_where_no_fruit_comes(speed: float, stands: bool) -> None:
    rig = BeltRig(speed)
    rig.watch.fruit.clear()
    end = await_fruit(rig, inputs={"within": 0.5})
    assert code(end) == "NOTHING_COMES"
    words = "the belt stands still, at 0.000 m/s; start it, or check its encoder"
    assert end.reason.message.endswith(words) is stands  # type: ignore[union-attr]


def test_a_rolling_fruit_is_waited_for_until_it_rests() -> None:
    rig = BeltRig(0.05, along=-0.6)
    rig.watch.alter = lambda track: replace(track, likelier=-1.0 if rig.clock.now() < 1.0 else 1.0)
    end = await_fruit(rig)
    assert end.status is Status.SUCCESS
    assert end.duration == pytest.approx(1.0, abs=0.05)


def test_frames_and_encoder_that_stop_end_the_wait() -> None:
    rig = BeltRig()
    rig.watch.fruit.clear()
    rig.watch.frames_until = 0.3
    assert code(await_fruit(rig)) == "STALE_FRAME"
    rig = BeltRig()
    rig.watch.fruit.clear()
    rig.conveyor.silent_from = 0.3
    assert code(await_fruit(rig)) == "ENCODER_FAULT"


def ages(watch: BeltWatch, camera: MockCamera, every: float, late: float) -> float:
    """Let frames come for two seconds, and return after what time without one they are missing [s]."""
    watch.newest_frame, shown = 0.0, drawn()
    for k in range(101):
        now = 0.02 * k
        stamp = every * int((now - late) / every)
        if stamp > 0.0:
            camera.show(replace(shown, stamp=stamp, sequence=round(stamp / every)))
        watch.note_frame(camera, now)
        assert watch.problem(now) == "", now
    return next(0.01 * k for k in range(1000) if watch.problem(watch.newest_frame + 0.01 * k))


@pytest.mark.parametrize(
    ("every", "late", "least", "most"),
    [
        (1.0 / 30.0, 0.065, 0.17, 0.19),
        (1.0 / 15.0, 0.065, 0.17, 0.21),
        (0.1, 0.1, 0.22, 0.28),
        (0.2, 0.2, 0.42, 0.48),
    ],
)
def test_frames_are_missing_once_they_are_later_than_lately(
    every: float, late: float, least: float, most: float
) -> None:
    watch = BeltWatch(load_fruit("apple"), the_belt(), encoder=True)
    assert least <= ages(watch, MockCamera(), every, late) <= most


def test_a_frame_that_is_older_than_the_newest_or_of_the_future_makes_no_frame_newer() -> None:
    watch, camera = BeltWatch(load_fruit("apple"), the_belt(), encoder=True), MockCamera()
    for stamp, newest in ((1.0, 1.0), (0.9, 1.0), (9.0, 1.02)):
        camera.show(replace(drawn(), stamp=stamp))
        watch.note_frame(camera, 1.02)
        assert watch.newest_frame == newest


def test_a_frame_from_an_arm_needs_the_arm() -> None:
    rig = BeltRig()
    rig.camera.show(replace(drawn(), q=np.zeros(7)))
    assert code(await_fruit_unscripted(rig)) == "NO_FRAME"


def test_interrupted_while_it_waits_nothing_moves() -> None:
    rig = BeltRig()
    rig.watch.fruit.clear()
    end = await_fruit(rig, interrupt_after=5)
    assert end.status is Status.INVALID
    assert not rig.arm.followed


def test_an_unreadable_frame_is_no_frame() -> None:
    rig = BeltRig()

    def unreadable() -> Frame:
        raise FrameUnreadable("camera", "the file is cut off")

    rig.camera.latest = unreadable  # type: ignore[method-assign,assignment]
    devices = {Camera: rig.camera, Conveyor: rig.conveyor, Arm: rig.arm}
    assert code(drive(Track(), {"fruit": "apple"}, devices, clock=rig.clock)) == "NO_FRAME"
    assert code(await_fruit_unscripted(rig)) == "NO_FRAME"


def await_fruit_unscripted(rig: BeltRig) -> SkillEnd:
    """Drive AwaitFruit with tracks that look at the camera's frames."""
    devices = {Camera: rig.camera, Cameras: Cameras((rig.camera,)), Conveyor: rig.conveyor}
    watch = BeltWatch(load_fruit("apple"), the_belt(), encoder=True)
    return drive(AwaitFruit(), {"tracks": watch}, devices, clock=rig.clock)


def test_the_operator_sees_the_belt_its_fruit_and_their_ellipses() -> None:
    rig = BeltRig(along=-0.5)
    rig.watch.fruit[1] = (-0.6, 0.03)
    rig.watch.alter = lambda track: (
        replace(track, likelier=-1.0) if rig.clock.now() < 0.5 else track
    )
    end = await_fruit(rig)
    scenes = [view for topic, view in end.published if topic == "belt"]
    tables = [view for topic, view in end.published if topic == "fruit"]
    assert len(scenes) == len(tables) == 3  # every 0.2 s
    assert [line.label.split(" (")[0] for line in scenes[-1].lines] == [  # type: ignore[attr-defined]
        "belt", "where fruit 0 will be in 0.5 s", "where fruit 1 will be in 0.5 s",
    ]  # fmt: skip
    ring = scenes[-1].lines[1].points  # type: ignore[attr-defined]
    shown_at = 0.4
    assert ring.mean(axis=0)[:2] == pytest.approx([-0.5 + 0.15 * (shown_at + 0.5), -0.34], abs=3e-3)
    assert [row[0] for row in tables[-1].rows] == ["0", "1"]  # type: ignore[attr-defined]
