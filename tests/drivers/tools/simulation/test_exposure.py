"""Frames arrive after their exposure, in order; what moves is blurred, and depth may be of another moment."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.executive.clock import ManualClock
from pomona.tools.simulation.camera import Delivery, SimCamera
from pomona.tools.simulation.exposure import STEP, Timing


def exposed(clock: ManualClock) -> Frame:
    """The frame of this moment of a camera with 30 frames a second."""
    colour = np.zeros((2, 2, 3), np.uint8)
    return Frame(
        clock.now(),
        int(clock.now() * 30 + 1e-6),
        colour,
        None,
        Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2),
        None,
        np.eye(4),
    )


def ages(latency: tuple[float, float], count: int = 100) -> tuple[list[float], list[int]]:
    clock = ManualClock()
    delivery, newest, found, numbers = Delivery(clock, latency, 3), None, [], []
    for _ in range(count):
        now = exposed(clock)
        newest = now if newest is None or now.sequence != newest.sequence else newest
        frame = delivery.newest(newest)
        assert frame is not None
        found.append(clock.now() - frame.stamp)
        numbers.append(frame.sequence)
        clock.advance(0.01)
    return found, numbers


def test_without_a_latency_the_frame_of_this_moment_is_delivered() -> None:
    found, _ = ages((0.0, 0.0))
    assert max(found) < 1.0 / 30.0 + 0.011


def test_with_a_latency_frames_are_as_old_as_it_and_a_period_more_at_most() -> None:
    found, _ = ages((0.05, 0.05))
    assert found[0] == 0.0
    assert min(found[12:]) >= 0.05 - 1e-9
    assert max(found[12:]) < 0.05 + 1.0 / 30.0 + 0.021


def test_with_a_latency_that_varies_no_frame_overtakes_another() -> None:
    _, numbers = ages((0.03, 0.09), 300)
    assert (np.diff(numbers) >= 0).all()
    assert len(set(numbers)) > 60


def test_after_a_silence_the_first_frame_is_new() -> None:
    clock = ManualClock()
    delivery = Delivery(clock, (0.05, 0.05), 3)
    for _ in range(20):
        delivery.newest(exposed(clock))
        clock.advance(0.02)
    clock.advance(2.0)
    frame = delivery.newest(exposed(clock))
    assert frame is not None
    assert frame.stamp == pytest.approx(clock.now())
    assert delivery.newest(None) is None


@pytest.mark.parametrize("exposure", [0.0, 0.001, 0.008, 0.0333])
def test_the_pictures_of_a_blurred_one_lie_evenly_about_its_stamp(exposure: float) -> None:
    moments = np.array(Timing(exposure=exposure).colour)
    assert moments.sum() == pytest.approx(0.0, abs=1e-12)
    assert np.diff(moments).max(initial=0.0) <= STEP + 1e-12
    assert np.ptp(moments) <= exposure


V_RIGHT = 0.5
"""Speed of the moved fruit towards the right border of the picture [m/s]."""


@pytest.fixture
def take(open_cell):
    """Take a frame from where the camera of the cell is, while the fruit has this velocity in the picture."""
    cell = open_cell(seed=3)
    riding, world = cell.device(Camera), cell.devices["world"]
    site = world.state.site("camera")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = site.xmat.reshape(3, 3), site.xpos
    joint = world.model.body("fruit_0").jntadr[0]
    velocity, place = world.model.jnt_dofadr[joint], world.model.jnt_qposadr[joint]
    start = world.state.qpos[place : place + 3].copy()

    def take_one(timing: Timing | None = None, speed: float = V_RIGHT, moved: float = 0.0) -> Frame:
        world.state.qvel[velocity : velocity + 3] = speed * T[:3, 0]
        world.state.qpos[place : place + 3] = start + moved * T[:3, 0]
        world.mujoco.mj_kinematics(world.model, world.state)
        camera = SimCamera(world, riding._intrinsics, riding._stereo, 30.0, T, timing)
        frame = camera.latest()
        camera.close()
        assert frame is not None
        return frame

    return take_one


def test_depth_of_another_moment_shows_moving_fruit_where_it_is_then(take) -> None:
    late, then = take(Timing(depth_after=0.02)), take(moved=0.02 * V_RIGHT)
    now = take()
    assert np.mean(late.depth != then.depth) < 1e-4  # which step of a millimetre a depth falls on
    np.testing.assert_array_equal(late.colour, now.colour)
    assert np.mean(np.abs(late.depth - now.depth) > 5e-3) > 1e-3
    early, before = take(Timing(depth_after=-0.02)), take(moved=-0.02 * V_RIGHT)
    assert np.mean(early.depth != before.depth) < 1e-4


def test_an_exposure_blurs_what_moves_and_nothing_else(take) -> None:
    def sharpness(frame: Frame, where: np.ndarray) -> float:
        steps = np.abs(np.diff(frame.colour.astype(np.float64), axis=1)).max(axis=2)
        return float(np.percentile(steps[where[:, 1:]], 99.0))

    sharp, blurred = take(), take(Timing(exposure=0.016))
    near = np.abs(take(moved=0.02).depth - take(moved=-0.02).depth) > 5e-3  # where the fruit passes
    assert sharpness(blurred, near) < 0.7 * sharpness(sharp, near)
    far = ~near
    assert np.mean(np.abs(blurred.colour[far].astype(float) - sharp.colour[far]) > 2.0) < 0.02
    np.testing.assert_array_equal(blurred.depth, sharp.depth)
    at_once, slowly = (
        take(timing, speed=0.0).colour for timing in (Timing(), Timing(exposure=0.016))
    )
    assert np.mean(at_once != slowly) < 1e-4  # the rest of the world still settles
