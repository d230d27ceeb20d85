"""Fruit on a belt from frame to frame: which is which, which are new, which are gone.

A fruit is found by its detector, measured once, and then fitted into every frame at the place where its filter expects
it. Two filters follow each: one for a fruit that rests on the belt, one for a fruit that rolls. All values are in the
belt's frame (x with the travel, z up) unless a name says another one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pomona.applications.conveyor.conveyor import Belt
from pomona.applications.conveyor.track_filter import (
    CARRIED,
    FREE,
    ROLLING,
    FruitState,
    MotionModel,
    begin,
    predict,
    update,
)
from pomona.drivers import Frame
from pomona.executive import Float64
from pomona.skills import inverse, transform
from pomona.skills.perception import (
    DepthLook,
    Detection,
    FruitModel,
    MeasuredFruit,
    RefineError,
    fit_place,
    horizontal_plane,
    measure,
)

BORN = 10  # frames in which a fruit must have been measured before it counts
GONE = 3  # frames in a row in which a fruit should have been seen and was not, after which its track ends
GATE = 60.0  # squared innovation beyond which a measurement is another object's
SAME = 0.03  # distance of a detection's ray from a known fruit within which it is that fruit [m]
EDGE = 0.04  # share of the picture at its edges in which a fruit is expected but not missed
CLOSE_TO_EDGE = 0.11  # the same for a new fruit: its whole surface is measured at first
NO_DEPTH = 0.26
"""Distance of a fruit's middle from the camera below which there may be no depth of it [m]: a D435i measures from 180
mm on, and the fruit's skin is nearer by half its size."""
FORGETS = 0.85  # share of the models' likelihoods that is kept from frame to frame
RECENT = 0.9  # share of the mean squared innovation that is kept from frame to frame


@dataclass(frozen=True, slots=True, eq=False)
class FruitTrack:
    """One fruit.

    Attributes:
        number: counted from 0 in the order of birth.
        measured: its first measurement; mesh: the model of its own size, one object for the track's whole life.
        resting, rolling: its filters; likelier: logarithm of the likelihood of the first over the second, lately.
        hits, missed: frames in which it was measured, and in a row was not.
        innovation: mean squared innovation lately: 3 where the stamps of camera, joints and belt agree.
    """

    number: int
    measured: MeasuredFruit
    mesh: FruitModel
    R_base_fruit: Float64
    resting: FruitState
    rolling: FruitState
    likelier: float = 0.0
    hits: int = 1
    missed: int = 0
    innovation: float = 3.0

    @property
    def dimensions(self) -> Float64:
        """(d_x, d_y, d_z) [m], shape (3,)."""
        return self.measured.dimensions

    @property
    def rests(self) -> bool:
        """Whether it lies still on the belt, as far as the camera has seen."""
        return self.hits >= BORN and self.likelier >= 0.0

    def innovation_since(self, earlier: FruitTrack) -> float:
        """Return the mean as if it had begun at an earlier state of the track, with 3; a fast camera may be before."""
        return self.innovation - RECENT ** (self.hits - earlier.hits) * (earlier.innovation - 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class BeltFrame:
    """One frame with the camera's pose, and the belt's travel at its exposure [m]."""

    frame: Frame
    T_base_camera: Float64
    travelled: float


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """All fruit on a belt, and how new ones are found.

    Attributes:
        model: the kind of fruit.
        belt: where it runs; `encoder`: whether the travel is measured.
        tracks: the fruit, oldest first; born: number of the next one.
    """

    model: FruitModel
    belt: Belt
    encoder: bool
    tracks: tuple[FruitTrack, ...] = ()
    born: int = 0

    @property
    def still(self) -> MotionModel:
        """Model of a fruit that rests on the belt."""
        return CARRIED if self.encoder else FREE

    def track(self, number: int) -> FruitTrack | None:
        """Return a fruit by its number; None once its track has ended."""
        return next((track for track in self.tracks if track.number == number), None)

    def expected(self, track: FruitTrack, t: float, travelled: float) -> tuple[Float64, Float64]:
        """Return place, shape (3,) [m], and its covariance, (3, 3) [m²], of a resting fruit at a time, belt frame."""
        ahead = predict(track.resting, t, travelled, self.still)
        return ahead.place, ahead.place_covariance

    def look(self, at: BeltFrame, find: Callable[[Frame], Sequence[Detection]] | None) -> Tracks:
        """Return the tracks after a frame; `find` detects fruit in it, None: nothing new is looked for."""
        kept = [
            followed for track in self.tracks if (followed := self._follow(track, at)).missed < GONE
        ]
        born = self.born
        for detection in () if find is None else find(at.frame):
            if self._is_new(detection, at, kept):
                measured = self._measured(detection)
                if measured is not None:
                    kept.append(self._begin(born, measured, at))
                    born += 1
        return replace(self, tracks=tuple(kept), born=born)

    def _follow(self, track: FruitTrack, at: BeltFrame) -> FruitTrack:
        t = at.frame.stamp
        if t <= track.resting.t:
            return track
        resting = predict(track.resting, t, at.travelled, self.still)
        rolling = predict(track.rolling, t, at.travelled, ROLLING)
        expected = resting if track.likelier >= 0.0 else rolling
        p_base = self._to_base(expected.place)
        if expected.place[0] > self.belt.length / 2.0:
            return replace(track, missed=GONE)
        if not _inside(p_base, at, EDGE):
            return track
        place = self._fit(track, p_base, at)
        if place is None:
            return track if _too_near(p_base, at) else replace(track, missed=track.missed + 1)
        rested, square, as_resting = update(resting, place)
        rolled, other, as_rolling = update(rolling, place)
        if min(square, other) > GATE and track.hits > GONE:
            return replace(track, missed=track.missed + 1)
        return replace(
            track,
            resting=rested,
            rolling=rolled,
            likelier=float(
                np.clip(FORGETS * track.likelier + as_resting - as_rolling, -20.0, 20.0)
            ),
            hits=track.hits + 1,
            missed=0,
            innovation=RECENT * track.innovation + (1.0 - RECENT) * square,
        )

    def _fit(self, track: FruitTrack, p_base: Float64, at: BeltFrame) -> Float64 | None:
        """Return the measured place in the belt's frame, shape (3,) [m]; None where the fruit is not seen."""
        frame = at.frame
        if frame.depth is None:
            return None
        look = DepthLook(frame.depth, frame.intrinsics, frame.depth_model, renderer="zbuffer")
        T_camera_mesh = inverse(at.T_base_camera) @ transform(track.R_base_fruit, p_base)
        try:
            fit = fit_place(
                look, track.mesh, T_camera_mesh, horizontal_plane(at.T_base_camera, self.belt.top)
            )
        except RefineError:
            return None
        place: Float64 = (
            inverse(self.belt.T_base_belt) @ at.T_base_camera @ np.append(fit.p_camera, 1.0)
        )[:3]
        return place

    def _begin(self, number: int, measured: MeasuredFruit, at: BeltFrame) -> FruitTrack:
        stretched = self.model.vertices * (measured.dimensions / self.model.dimensions)
        mesh = replace(self.model, vertices=stretched, dimensions=measured.dimensions)
        place = (inverse(self.belt.T_base_belt) @ measured.T_base_fruit[:, 3])[:3]
        t = at.frame.stamp
        travelled = at.travelled
        filters = begin(t, travelled, place, self.still), begin(t, travelled, place, ROLLING)
        return FruitTrack(number, measured, mesh, measured.T_base_fruit[:3, :3], *filters)

    def _measured(self, detection: Detection) -> MeasuredFruit | None:
        try:
            return measure(detection, "shape", None, "zbuffer", self.belt.top)
        except RefineError:
            return None

    def _is_new(self, detection: Detection, at: BeltFrame, known: Sequence[FruitTrack]) -> bool:
        eye = at.T_base_camera[:3, 3]
        p_base = (at.T_base_camera @ detection.T_camera_object)[:3, 3]
        if not _inside(p_base, at, CLOSE_TO_EDGE):
            return False
        ray = (p_base - eye) / np.linalg.norm(p_base - eye)
        for track in known:
            place = predict(track.resting, at.frame.stamp, at.travelled, self.still).place
            if np.linalg.norm(np.cross(ray, self._to_base(place) - eye)) < SAME:
                return False
        return True

    def _to_base(self, place: Float64) -> Float64:
        p_base: Float64 = (self.belt.T_base_belt @ np.append(place, 1.0))[:3]
        return p_base


def _too_near(p_base: Float64, at: BeltFrame) -> bool:
    """Return True if a camera has no depth of a fruit since it is so near."""
    return bool((inverse(at.T_base_camera) @ np.append(p_base, 1.0))[2] < NO_DEPTH)


def _inside(p_base: Float64, at: BeltFrame, edge: float) -> bool:
    """Return True if a point is in the picture, and not within a share of it at its edges."""
    lens = at.frame.intrinsics
    x, y, z = (inverse(at.T_base_camera) @ np.append(p_base, 1.0))[:3]
    if z <= 0.0:
        return False
    u = (lens.fx * x / z + lens.cx) / lens.width
    v = (lens.fy * y / z + lens.cy) / lens.height
    return bool(edge < u < 1.0 - edge and edge < v < 1.0 - edge)
