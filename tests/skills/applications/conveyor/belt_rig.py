"""Mock devices beside a belt whose fruit is where a script has it: no camera is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from pomona.applications.conveyor.await_fruit import ComingFruit
from pomona.applications.conveyor.belt_watch import BeltWatch
from pomona.applications.conveyor.conveyor import BELT, Belt, Conveyor, ConveyorState
from pomona.applications.conveyor.devices import OVER
from pomona.applications.conveyor.intercept import Intercept
from pomona.applications.conveyor.track_filter import FruitState
from pomona.applications.conveyor.tracks import FruitTrack
from pomona.drivers import (
    Arm,
    Camera,
    Cameras,
    Carrier,
    Device,
    ForceSensor,
    Gripper,
    Pads,
    StopFailed,
    StreamedArm,
    Workspace,
    read_cell_file,
)
from pomona.executive import Clock, SkillEnd, drive, find_cell
from pomona.skills.motion import RobotModel
from pomona.skills.perception import MeasuredFruit
from pomona.tools.mock import MockArm, MockCamera, MockClock, MockForceSensor, MockGripper
from pomona.tools.mock.arm import ROBOT
from tests.skills.finger_pads import finger_pads
from tests.skills.picking_scene import apple_at

SIZE = np.array([0.073, 0.064, 0.073])
STAND = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
MODEL = RobotModel.load(ROBOT)


@cache
def workspace() -> Workspace:
    found = read_cell_file(find_cell("conveyor")).workspace
    assert found is not None
    return found


def the_belt() -> Belt:
    T = np.eye(4)
    T[:3, 3] = 0.0, -0.36, -0.12
    return Belt(T, 1.8, 0.24)


def measured_at(along: float, aside: float, size: np.ndarray = SIZE) -> MeasuredFruit:
    T = np.eye(4)
    T[:3, :3] = STAND
    T[:3, 3] = along, -0.36 + aside, -0.12 + size[1] / 2.0
    return replace(apple_at(1, 1), T_base_fruit=T, dimensions=size)


class ScriptedWatch(BeltWatch):
    """Tracks of fruit that goes with the belt, or by a script.

    Attributes:
        fruit: by number: place along and beside the belt at time 0 [m].
        spread: deviation of each place, level [m]; its velocity's is a fifth of it a second.
        alter: changes a track before it is seen.
    """

    def __init__(self, rig: BeltRig, encoder: bool = True) -> None:
        super().__init__(apple_at(1, 1).fruit, rig.conveyor.belt, encoder)
        self.rig = rig
        self.fruit: dict[int, tuple[float, float]] = {}
        self.spread, self.frames_until = 5e-4, np.inf
        self._oldest = 0.12  # as after a second of frames of 30 Hz
        self.alter: Callable[[FruitTrack], FruitTrack | None] = lambda track: track

    def step(self, *_: Any, **__: Any) -> None:
        self.travel.note(self.rig.conveyor.travelled())
        now = self.rig.clock.now()
        self.note_frame(self.rig.camera, now)
        seen = [self.alter(self.seen(number, now)) for number in self.fruit]
        self.tracks = replace(
            self.tracks, tracks=tuple(track for track in seen if track is not None)
        )

    def note_frame(self, camera: Camera, now: float, searches: bool = False) -> None:
        if now <= self.frames_until:
            self.newest_frame = now

    def seen(self, number: int, now: float) -> FruitTrack:
        along, aside = self.fruit[number]
        travelled = self.rig.conveyor.travel(now)
        x = np.zeros(9)
        x[:3] = along + travelled, aside, self.rig.size[1] / 2.0
        deviations = np.array([self.spread] * 3 + [self.spread / 5.0] * 2 + [1e-5] + [1e-4] * 3)
        state = FruitState(now, self.travel.at(now), x, np.diag(deviations**2))
        measured = measured_at(along, aside, self.rig.size)
        model = replace(measured.fruit, dimensions=self.rig.size)
        return FruitTrack(number, measured, model, STAND, state, state, likelier=5.0, hits=20)


class MockConveyor(Device):
    """A belt that runs by a function of time, and can be stopped.

    Attributes:
        travel: position at a time; replace it to script the belt.
        silent_from: time from which the encoder sends nothing more [s].
        stops: result of `stop`, or the error that it raises; stopped_at: when it was stopped [s].
    """

    interfaces = BELT
    stops: bool | StopFailed = True
    stopped_at: float | None = None

    def __init__(self, clock: Clock, belt: Belt, speed: float = 0.15) -> None:
        super().__init__("conveyor")
        self.belt = belt
        self.travel: Callable[[float], float] = lambda t: speed * t
        self.silent_from = np.inf
        self._clock = clock

    def travelled(self) -> ConveyorState | None:
        now = min(self._clock.now(), self.silent_from)
        return ConveyorState(
            now, self.travel(now), (self.travel(now) - self.travel(now - OVER)) / OVER
        )

    def stop(self) -> bool:
        if isinstance(self.stops, StopFailed):
            raise self.stops
        if self.stops and self.stopped_at is None:
            at, travel = self._clock.now(), self.travel
            self.stopped_at, self.travel = at, lambda t: travel(min(t, at))
        return self.stops


class BeltRig:
    """An arm at the belt, and a fruit that the fingers meet where it is."""

    def __init__(
        self,
        speed: float = 0.15,
        along: float = -0.45,
        aside: float = 0.02,
        size: np.ndarray = SIZE,
    ) -> None:
        self.clock, self.size = MockClock(), size
        self.arm = MockArm(self.clock, workspace().poses["watch"])
        self.gripper = MockGripper(self.clock, width=0.10)
        self.fingers = MockForceSensor(self.clock)
        self.fingers.feel = self._feel
        self.conveyor = MockConveyor(self.clock, the_belt(), speed)
        self.camera = MockCamera()
        self.watch = ScriptedWatch(self)
        self.watch.fruit[0] = (along, aside)
        self.there = True
        self.paths: list[np.ndarray] = []
        self.clock.each_step.append(lambda: self.paths.append(self.arm.q.copy()))

    @property
    def target(self) -> ComingFruit:
        along, aside = self.watch.fruit[0]
        measured = measured_at(along, aside, self.size)
        return ComingFruit(0, measured, measured.T_base_fruit[:3, 3], 0.15)

    @property
    def devices(self) -> dict[type, object]:
        return {
            Arm: self.arm, StreamedArm: self.arm, Gripper: self.gripper, ForceSensor: self.fingers,
            Workspace: workspace(), Conveyor: self.conveyor, Carrier: self.conveyor, Camera: self.camera,
            Cameras: Cameras((self.camera,)), Pads: finger_pads(0.79, 0.125),
        }  # fmt: skip

    @property
    def height(self) -> float:
        """Of the hand over the fruit's middle [m]."""
        return float(self.hand()[2, 3] + 0.12 - self.size[1] / 2.0)

    def hand(self) -> np.ndarray:
        """T_base_tcp, (4, 4) [m]."""
        return MODEL.tcp(self.arm.q)

    def intercept(self, skill: Intercept | None = None, **how: Any) -> SkillEnd:
        inputs = {"target": self.target, "tracks": self.watch, **how.pop("inputs", {})}
        return drive(skill or Intercept(), inputs, self.devices, clock=self.clock, **how)

    def _feel(self, _now: float) -> np.ndarray:
        """A soft fruit between the pads, if the hand is around it or has taken it along."""
        wrenches = np.zeros((2, 6))
        T = self.hand()
        squeezed = max(self.size[0] - self.gripper.width, 0.0)
        if self.there and squeezed > 0.0:
            along, aside = self.watch.fruit[0]
            on_belt = np.array([along + self.conveyor.travel(self.clock.now()), -0.36 + aside])
            held = T[2, 3] + 0.12 > self.size[1] / 2.0 + 0.005
            if held or np.linalg.norm(T[:2, 3] - on_belt) < 0.015:
                wrenches[:, 2] = -1000.0 * squeezed
                wrenches[:, 0] = 0.65 if held else 0.0
        return wrenches
