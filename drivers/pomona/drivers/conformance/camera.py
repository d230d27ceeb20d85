"""Claims of cameras, judged by what truly stands before them, and when."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pomona.drivers.conformance.bench import Bench
from pomona.drivers.conformance.claims import Claims, Finding, judge_notice
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.clock import Clock

SILENCE = 0.5  # without a valid picture for this long, a camera is lost [s]
LASTS = 2.0 * SILENCE  # a harm of this length is noticed [s]
TICK = 0.02  # between two looks [s]
EARLY = 0.02  # a stamp is ahead of the cell's clock by less than this [s]
FAR = 20.0  # no measured depth is larger [m]: one in millimetres is
FITS = 1e-3  # share by which told intrinsics differ from the true ones


class Wall:
    """What stands before a camera: a wall that comes nearer, so that its distance tells when a picture was taken."""

    def __init__(self, clock: Clock, start: float = 0.8, speed: float = 0.05) -> None:
        """`start` is its first distance [m], `speed` that by which it comes nearer [m/s]."""
        self._clock, self._start, self._speed = clock, start, speed
        self._began = clock.now()

    def distance(self) -> float:
        """Return its distance now, along the camera's axis [m]."""
        return self._start - self._speed * (self._clock.now() - self._began)


class CameraBench(Bench):
    """A camera's driver, and what truly stands before the camera.

    Attributes:
        got: frames that a look has shown for the first time, each with the time of that.
    """

    def __init__(
        self,
        device: object,
        clock: Clock,
        distance: Callable[[], float],
        lens: Intrinsics,
        *switches: FaultSwitch,
        tolerance: float = 5e-3,
        holds: Callable[[], bool] = lambda: False,
        without: tuple[str, ...] = (),
    ) -> None:
        """
        Args:
            distance: true depth in the middle of the picture now [m].
            lens: true intrinsics.
            tolerance: of a depth, with its noise and the way in the jitter of a stamp [m].
            holds: whether the driver holds the device, such as an open connection.
            switches, without: see the base.
        """
        super().__init__(device, clock, *switches, without=without)
        self.lens = lens
        self.tolerance = tolerance
        self.holds = holds
        self.got: list[tuple[float, Frame]] = []
        self._distance = distance
        self._truth = [(self.now, distance())]
        self.each_step.append(self._look)
        self.serve(SILENCE)

    def newest(self) -> Frame:
        """Return the newest frame. Raises Finding: there is none."""
        if not self.got:
            raise Finding("it shows nothing")
        return self.got[-1][1]

    def told(self, frame: Frame) -> float:
        """Return the depth in the middle of a frame [m]."""
        if frame.depth is None:
            return self.true(frame)  # of a colour camera
        row, column = round(self.lens.cy), round(self.lens.cx)
        middle = frame.depth[row - 2 : row + 3, column - 2 : column + 3]
        return float(np.median(middle[middle > 0.0]))

    def true(self, frame: Frame) -> float:
        """Return the true depth there at the frame's stamp [m]."""
        times, depths = np.transpose(self._truth)
        return float(np.interp(frame.stamp, times, depths))

    def _look(self) -> None:
        if self.now - self._truth[-1][0] < TICK - 1e-9:
            return
        self._truth.append((self.now, self._distance()))
        frame = self.device.latest()
        last = self.got[-1][1] if self.got else None
        if frame is not None and (last is None or frame.stamp != last.stamp):
            self.got.append((self.now, frame))


Opened = Callable[[], CameraBench]
CAMERA: Claims[CameraBench] = Claims("camera")


def camera_claims(**benches: Opened) -> Callable[..., None]:
    """Return a test for pytest of every claim, for each bench by its name."""
    return CAMERA.tests(**benches)


@CAMERA.essential
def a_harm_is_noticed(opened: Opened) -> None:
    """A camera that is silent, frozen or lies is reported, until that is acknowledged."""
    judge_notice(opened, LASTS)


@CAMERA.essential
def no_look_shows_the_past(opened: Opened) -> None:
    """A frame shows what was there at its stamp, which is shortly before the look, in the cell's time."""
    for harm in ("", *opened().harms):
        bench = opened()
        bench.harm(harm, LASTS)
        bench.heal()
        bench.serve(LASTS)
        for at, frame in bench.got:
            if not -EARLY <= at - frame.stamp <= SILENCE:
                raise Finding(f"'{harm}': a look shows a frame {at - frame.stamp:.3g} s old")
            apart = abs(bench.told(frame) - bench.true(frame))
            if not apart <= bench.tolerance:
                raise Finding(f"'{harm}': a frame is {1e3 * apart:.1f} mm off what was there")


@CAMERA.claim
def stamps_increase(opened: Opened) -> None:
    """Frames come in the order of their stamps and numbers, and without a pause."""
    bench = opened()
    bench.got.clear()
    bench.serve(2.0)
    times, frames = zip(*bench.got, strict=True) if bench.got else ((), ())
    stamps = [frame.stamp for frame in frames]
    if len(stamps) < 3 or max(np.diff(times)) > SILENCE:
        raise Finding(f"{len(stamps)} frames came in 2 s")
    if min(np.diff(stamps)) <= 0.0 or min(np.diff([frame.sequence for frame in frames])) < 0:
        raise Finding("a frame is not after the last one by its stamp and number")


@CAMERA.claim
def intrinsics_fit_the_picture(opened: Opened) -> None:
    """Intrinsics are those of the picture that they come with."""
    bench = opened()
    frame = bench.newest()
    for part in ("fx", "fy", "cx", "cy", "width", "height"):
        told = getattr(frame.intrinsics, part)
        true = getattr(bench.lens, part)
        if abs(told - true) > FITS * true:
            raise Finding(f"{part} is told as {told:g} px, and is {true:g} px")
    if frame.colour.shape != (bench.lens.height, bench.lens.width, 3):
        raise Finding(f"a picture has the shape {frame.colour.shape}")


@CAMERA.claim
def depth_is_in_metres(opened: Opened) -> None:
    """Depth is in metres, and 0 or NaN where nothing was measured."""
    bench = opened()
    frame = bench.newest()
    if frame.depth is None:
        return
    known = frame.depth[~np.isnan(frame.depth) & (frame.depth != 0.0)]
    if not ((known > 0.0) & (known < FAR)).all():
        raise Finding(f"it tells depths from {known.min():g} to {known.max():g}")
    told = bench.told(frame)
    true = bench.true(frame)
    if not abs(told - true) <= bench.tolerance:
        raise Finding(f"it tells {told:g} where there are {true:.3f} m")


@CAMERA.claim
def a_frame_stays_as_it_is(opened: Opened) -> None:
    """A frame that was shown does not change while others come."""
    bench = opened()
    frame = bench.newest()
    images = [image for image in (frame.colour, frame.depth) if image is not None]
    kept = [image.copy() for image in images]
    bench.serve(LASTS)
    if not all(map(partial(np.array_equal, equal_nan=True), kept, images)):
        raise Finding("pixels that were handed out are others later")


@CAMERA.claim
def an_end_releases_the_camera(opened: Opened) -> None:
    """Closing a driver lets the camera go, also twice."""
    bench = opened()
    bench.device.close()
    bench.device.close()
    if bench.holds():
        raise Finding("it still holds the device")
