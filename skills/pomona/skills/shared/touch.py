"""Contact during a motion: unexpected contact, weight that comes or goes, a fruit between the fingers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from pomona.drivers.interfaces import (
    Box,
    ForceSensor,
    Gripper,
    LoadSensor,
    PressSensor,
    WrenchSample,
    WrenchSensor,
)
from pomona.executive.skill import Skill
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.collision import fruit_points
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.gripper_shape import GripperShape

# a newest sample older than this means that the fingers feel nothing any more [s]
STALE_AFTER = 0.1
SPIKE = 3  # number of successive samples that confirm a change of force: one sample may be a spike

PRESSING = 0.05  # time over which a press on a fruit is averaged: shorter ones bruise none [s]
# pressing force of each finger that shows something between them [N]; noise: 0.2 N
HELD_FORCE = 0.25
FINE = 1.0  # smallest change that a load sensor must show to feel a support [N]: a fruit is pressed no harder


def each_finger(forces: Float64) -> Float64:
    """Return the force on each finger, which a touch of the empty fingers changes, (2, 3) -> (2, 3)."""
    return forces


def load(forces: Float64) -> Float64:
    """Return the force along both pads together, which a contact of a held fruit changes, (2, 3) -> (1, 2).

    The pads' y axes point in opposite directions (z out of either face, x along the approach), hence the signs. The
    pressing force is left out: the grip's controller changes it.
    """
    return np.array([[forces[0, 0] + forces[1, 0], forces[0, 1] - forces[1, 1]]])


NEAR = 0.25
LEVEL = 0.002
FLAT = 0.014
STEEPER = 2.0
SINKS = 0.05
"""Reach of the hand across the approach [m], and displacement along it that no check shows [m]; speed at which a tip
lands on a level surface with 10 N [m/s] (`bench_approach`), of an arm that stops at once; power of a surface's cosine
by which it falls; `reaction` of an arm that lands with as much at half of this speed [s]."""


def landing_speeds(
    shape: GripperShape,
    grasp: Grasp,
    obstacles: Iterable[Box],
    width: float,
    length: float,
    unseen: float,
) -> Float64:
    """Return the largest speeds along a straight approach, at equal steps, shape (m,) [m/s].

    Where a fingertip is level with skin, or with the top of an obstacle, it may land on it; the flatter, the slower.
    `width` is the opening [m], `length` of the approach [m], `unseen` the displacement across it that may be there [m].
    """
    points = [np.empty((0, 3))]
    cosines = [np.empty(0)]
    approach = grasp.T_base_grasp[:3, 2]
    for fruit in (grasp.fruit, *grasp.fruit.beside):
        skin = fruit_points(fruit)
        normals = (
            (skin - fruit.T_base_fruit[:3, 3]) @ fruit.T_base_fruit[:3, :3] / fruit.dimensions**2
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        points.append(skin)
        cosines.append(-normals @ fruit.T_base_fruit[:3, :3].T @ approach)
    for box in obstacles:
        half = np.array(box.half_extents)
        below = apply(inverse(box.T_base_box), grasp.T_base_grasp[:3, 3])
        low, high = (np.clip(below + side, -half, half) for side in (-NEAR, NEAR))
        grid = np.linspace(low, high, int(NEAR / unseen) + 2)
        top = np.stack(
            [each.ravel() for each in np.meshgrid(grid[:, 0], grid[:, 1], half[2])], axis=1
        )
        points.append(apply(box.T_base_box, top))
        cosines.append(np.ones(len(top)))
    level = shape.levels(apply(inverse(grasp.T_base_grasp), np.vstack(points)), width, unseen)
    speeds = FLAT / np.maximum(np.concatenate(cosines), 0.01) ** STEEPER
    near = np.abs(np.linspace(length, 0.0, int(length / 1e-3) + 2)[:, None] - level) <= LEVEL
    most: Float64 = np.where(near, speeds, np.inf).min(axis=1)
    return most


class Touch:
    """Listens to both fingers, or a load sensor, and remembers how much the force has changed since the beginning.

    The first 10 ms are the reference: an offset of the sensors, or the weight of a held fruit, does not count. Use it
    as a context manager; the subscription ends with it. Without a sensor nothing changes.

    Attributes:
        change: largest lasting change so far [N].
        pressed: largest mean change over `PRESSING` so far [N].
        finger: the finger with the change: left or right; empty before any, and when there is one force.
    """

    def __init__(
        self, sensor: WrenchSensor | None, of: Callable[[Float64], Float64] = each_finger
    ) -> None:
        """Start listening; `of` maps forces (finger, axis) to the vectors (n, k) whose norms are compared."""
        self._sensor = sensor
        self._of = of
        self._mass, self._least = (
            (sensor.mass, sensor.least) if isinstance(sensor, LoadSensor) else (0.0, 0.0)
        )
        first = None if sensor is None else sensor.latest()
        self._reference = None if first is None else of(first.wrenches[:, :3])
        self._recent: deque[Float64] = deque(maxlen=SPIKE)
        rate = 1.0 if sensor is None else sensor.rate
        self._felt: deque[Float64] = deque(
            maxlen=max(1, round(0.1 * rate))
        )  # time of an average [s]
        self._first = round(
            0.01 * rate
        )  # samples whose mean is the reference: one sample has the noise of one
        self.change = self.pressed = self._press = 0.0
        self._weight = 1.0 / (PRESSING * rate)
        self.finger = ""
        self._limit = np.inf
        self._act = _nothing
        self._subscription = None if sensor is None else sensor.subscribe(self._on_sample)

    def __enter__(self) -> Touch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Listen no more."""
        if self._subscription is not None:
            self._subscription.close()

    def at_change(self, limit: float, act: Callable[[], None]) -> None:
        """Call `act` once in the sensor's own loop when a lasting change exceeds a limit [N].

        A skill looks once in a tick; an arm that must stop has moved on by then.
        """
        self._limit = limit
        self._act = act

    def limit(self, contact: float, acceleration: float) -> float:
        """Return the change [N] that shows a contact of this force [N] while the tool is accelerated [m/s²]."""
        return max(contact, self._least) + self._mass * acceleration

    def forget_change(self) -> None:
        """Start the largest change again; the reference stays."""
        self.change = 0.0
        self.finger = ""

    def begin_anew(self) -> None:
        """Start the largest change again, from the load of the last tenth of a second."""
        self.forget_change()
        if self._felt:
            self._reference = self.average()

    @property
    def present(self) -> float:
        """How much the force differs from the beginning now, lastingly [N]."""
        return float(np.min(self._recent, axis=0).max()) if len(self._recent) == SPIKE else 0.0

    def at_first(self) -> float:
        """Return the force at the beginning [N]; 0 before the first sample. The zero of a load sensor is unknown: 0."""
        return (
            0.0
            if self._reference is None or self._mass
            else float(np.linalg.norm(self._reference, axis=1).max())
        )

    def average(self) -> Float64:
        """Return the mean of the recent forces, shape (n, k) [N]."""
        mean: Float64 = np.mean(self._felt, axis=0)
        return mean

    def gone_back(self, before: Float64, now: Float64) -> float:
        """How far it has gone from `before` to `now`, shapes (n, k), towards the beginning [N]: the least of n."""
        assert self._reference is not None
        changed = before - self._reference
        along = ((before - now) * changed).sum(axis=1) / np.maximum(
            np.linalg.norm(changed, axis=1), 1e-9
        )
        return float(along.min())

    def stale_for(self, now: float) -> float:
        """Age of the newest sample [s] when that is more than `STALE_AFTER`; 0 while the stream flows."""
        if self._sensor is None:
            return 0.0
        newest = self._sensor.latest()
        age = np.inf if newest is None else now - newest.stamp
        return float(age) if age > STALE_AFTER else 0.0

    def _on_sample(self, sample: WrenchSample) -> None:
        felt = self._of(sample.wrenches[:, :3])
        if not np.isfinite(felt).all():
            return
        self._felt.append(felt)
        if len(self._felt) <= self._first or self._reference is None:
            self._reference = np.mean(self._felt, axis=0)
        self._recent.append(np.linalg.norm(felt - self._reference, axis=1))
        self._press += self._weight * (float(self._recent[-1].max()) - self._press)
        self.pressed = max(self.pressed, self._press)
        if len(self._recent) == SPIKE:
            lasting = np.min(self._recent, axis=0)
            if lasting.max() > self.change:
                self.change = float(lasting.max())
                self.finger = ("left", "right")[int(lasting.argmax())] if len(lasting) == 2 else ""
                if self.change > self._limit:
                    act = self._act
                    self._limit = np.inf
                    act()


def felt(skill: Skill, of: Callable[[Float64], Float64] | None = None) -> Touch:
    """Listen to the fingers or, in a cell without force fingers, to the load sensor: optional devices of the skill.

    `of` is of the fingers, see `Touch`; by default each counts, also of fingertips that feel nothing but pressing.
    """
    fingers = skill.optional_device(ForceSensor)
    sensor = skill.optional_device(LoadSensor)
    if fingers is None and of is None and (tips := skill.optional_device(PressSensor)) is not None:
        return Touch(tips)
    if fingers is None and sensor is not None:
        return Touch(sensor)
    return Touch(fingers, of or each_finger)


def hand_felt(skill: Skill) -> Touch:
    """Listen to a load sensor beside force fingers: it alone feels their tips and backs. Nothing changes without."""
    alone = skill.optional_device(ForceSensor) is None  # `felt` listens to it
    return Touch(None if alone else skill.optional_device(LoadSensor))


def weighing(skill: Skill) -> Touch | None:
    """Listen to a load sensor that feels a fruit's weight, in a cell without force fingers; None without one."""
    return (
        felt(skill, each_finger)
        if skill.optional_device(ForceSensor) is None and feels_support(skill)
        else None
    )


def feels_support(skill: Skill) -> bool:
    """Return True if a sensor of the cell feels a support below a held fruit before the fruit is pressed."""
    sensor = skill.optional_device(LoadSensor)
    return skill.optional_device(ForceSensor) is not None or (
        sensor is not None and sensor.least <= FINE
    )


def _nothing() -> None:
    """For a touch that nothing answers."""


def pressing_forces(sensor: WrenchSensor) -> tuple[float, float]:
    """Pressing force of the left and the right finger now [N]; 0 before the first sample."""
    sample = sensor.latest()
    if sample is None:
        return 0.0, 0.0
    return float(-sample.wrenches[0, 2]), float(-sample.wrenches[1, 2])


def something_between(gripper: Gripper, sensor: WrenchSensor) -> bool:
    """Return True if force and opening both show an object between the fingers."""
    # opening above the closed gripper's at which something is between the fingers [m]
    open_enough = gripper.state().width > gripper.limits.width_min + 2e-3
    return open_enough and min(pressing_forces(sensor)) > HELD_FORCE
