"""The tracks of a belt, kept up by the skill that runs: the value of a port.

`Track` makes it. A skill that lasts calls `step` in each of its ticks; frames are looked at beside the tick, one at a
time. Without a skill that steps it, it stands, and fruit that it knew is found again where the encoder expects it.
"""

from __future__ import annotations

from collections.abc import Callable

from pomona.applications.conveyor.conveyor import Belt, Conveyor
from pomona.applications.conveyor.tracks import BeltFrame, FruitTrack, Tracks
from pomona.applications.conveyor.travel import Travel
from pomona.drivers import Camera, DepthCamera, Frame
from pomona.executive import Computation, Float64, Skill
from pomona.skills import find_in_frame
from pomona.skills.perception import Detection, DetectorOptions, FruitModel

SEARCH_EVERY = 5  # frames from one search for new fruit to the next: a search takes 15 ms, a fit of one fruit 2 ms
WORKING_WIDTH = 320  # width at which a picture is searched [px]
SURE_SCORE = 0.5  # least score of a detection; a false one is given up after three frames
SOON = 0.17
LATER = 0.04
STALE = 0.5
"""Age of the newest frame from which frames are missing [s]: `LATER` than lately, within `SOON` and `STALE`. At
30 Hz and 65 ms of latency the newest is 120 to 140 ms old when the next one is there. No look takes `STALE`."""
FORGETS = 0.95
"""Share of the largest age lately that is kept from frame to frame; at first it is `STALE`, for a slow camera."""


class BeltWatch:
    """Tracks that are kept up.

    Attributes:
        tracks: as of the newest frame.
        travel: of the belt.
        tried, passed: numbers of fruit that were tried, and of fruit that passed the hand before that.
        newest_frame, shown_at: stamp of the newest frame, and when the belt was shown to the operator [s].
    """

    def __init__(self, model: FruitModel, belt: Belt, encoder: bool) -> None:
        self.tracks = Tracks(model, belt, encoder)
        self.travel = Travel()
        self.tried: set[int] = set()
        self.passed: set[int] = set()
        self.newest_frame = self.shown_at = -1.0
        self._pending: Computation | None = None
        self._sequence = -1
        self._frames = 0
        self._oldest = STALE
        self._began = 0.0

    @property
    def sentence(self) -> str:
        """Text for the operator."""
        if (
            self.newest_frame < 0.0
        ):  # written to a port before a look: the numbers would be wrong from the next tick on
            return "kept up while a skill watches the belt"
        return f"{len(self.tracks.tracks)} fruit on the belt, {self.tracks.born} seen so far"

    def step(
        self,
        skill: Skill,
        camera: Camera,
        conveyor: Conveyor,
        pose: Callable[[Frame], Float64],
        search: bool,
    ) -> None:
        """Take the newest frame and measurement, and look at one frame beside the tick.

        Args:
            pose: T_base_camera of a frame.
            search: whether new fruit is looked for in every fifth frame.
        """
        self.travel.note(conveyor.travelled())
        searches = search and self._frames % SEARCH_EVERY == 0
        now = skill.clock.now()
        frame = self.note_frame(camera, now, searches)
        if self._pending is not None:
            if not self._pending.done():
                return
            self.tracks = self._pending.result()
            self._pending = None
        if frame is None or frame.sequence == self._sequence:
            return
        self._sequence = frame.sequence
        self._began = now
        self._frames += 1
        at = BeltFrame(frame, pose(frame), self.travel.at(frame.stamp))
        find = self._finder(at.T_base_camera) if searches else None
        self._pending = skill.context.compute(
            skill.path, self.tracks.look, at, find, isolated=False
        )

    def note_frame(self, camera: Camera, now: float, searches: bool = False) -> Frame | None:
        """Return the newest frame, and note its age; a picture if it `searches`, where depth alone is quicker."""
        frame = (
            camera.latest()
            if searches or not isinstance(camera, DepthCamera)
            else camera.latest_depth()
        )
        if frame is not None and (stamp := min(frame.stamp, now)) > self.newest_frame:
            self._oldest = max(FORGETS * self._oldest, now - self.newest_frame)
            self.newest_frame = stamp
        return frame

    def problem(self, now: float) -> str:
        """Describe why nothing is seen any more, in half a sentence; empty while frames come and are looked at."""
        if now - self.newest_frame > (patience := min(max(self._oldest + LATER, SOON), STALE)):
            return f"no new frame for {1e3 * patience:.0f} ms"
        if self._pending is not None and not self._pending.done() and now - self._began > STALE:
            return f"the look at a frame has not ended within {1e3 * STALE:.0f} ms"
        return ""

    def place(self, track: FruitTrack, t: float) -> tuple[Float64, Float64]:
        """Return place and velocity of a resting fruit at a time in the base frame, shape (3,) each [m], [m/s]."""
        belt = self.tracks.belt
        step = 0.01
        at, _ = self.tracks.expected(track, t, self.travel.at(t))
        later, _ = self.tracks.expected(track, t + step, self.travel.at(t + step))
        turn = belt.T_base_belt[:3, :3]
        return belt.T_base_belt[:3, 3] + turn @ at, turn @ ((later - at) / step)

    def covariance(self, track: FruitTrack, t: float) -> Float64:
        """Covariance of the place at a time in the belt's frame, shape (3, 3) [m²]."""
        _, covariance = self.tracks.expected(track, t, self.travel.at(t))
        return covariance

    def _finder(self, T_base_camera: Float64) -> Callable[[Frame], list[Detection]]:
        model = self.tracks.model

        def find(frame: Frame) -> list[Detection]:
            found = find_in_frame(frame, model, DetectorOptions(working_width=WORKING_WIDTH))
            return [
                Detection(
                    model, frame, T_base_camera, i.T_camera_object, i.keypoints, i.score, i.covariance, k, len(found),
                    i.visibility,
                )
                for k, i in enumerate(found)
                if i.T_camera_object is not None and i.covariance is not None and i.score > SURE_SCORE
            ]  # fmt: skip

        return find
