"""Watch of the hand's way to a fruit on the belt and up with it: the cameras' frames against the planned postures."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from pomona.applications.conveyor.conveyor import Belt
from pomona.drivers import Arm, Motion, Surroundings, Trajectory, Workspace
from pomona.executive import Clock, Float64, Problem, Skill, Work
from pomona.skills import KnownAround, LiveWatch, ask_operator, prepare_watch, watched
from pomona.skills.motion import RobotModel, RobotShape

# least share of the belt that a camera must have in its picture to see a person beside it
IN_PICTURE = 0.3


class PlannedMotion:
    """A streamed motion whose progress is that of a plan, from `begin` to `end` [s]; all else is the motion's."""

    def __init__(self, motion: Motion, clock: Clock, begin: float, end: float) -> None:
        self._motion = motion
        self._clock = clock
        self._begin = begin
        self._end = end

    @property
    def progress(self) -> float:
        """Share of the plan's time that has passed, 0 to 1."""
        return float(
            np.clip((self._clock.now() - self._begin) / (self._end - self._begin), 0.0, 1.0)
        )

    def __getattr__(self, name: str) -> Any:
        return getattr(self._motion, name)


class ReachWatch:
    """The watch of a pick; it sees nothing in a cell whose file requests none. Made before the hand is streamed.

    A camera on the hand sees nothing behind itself. Things in the `passing` volumes of the cell count as goods.
    """

    def __init__(self, skill: Skill) -> None:
        self._skill, self._arm = skill, skill.device(Arm)
        self._eyes: LiveWatch | None = None

    def open(self) -> Work[None]:
        """Wait until a motion may start: see `watched`."""
        self._eyes = yield from watched(self._skill, None, KnownAround())

    def sees_free(self) -> Work[bool]:
        """Return True if the way that has begun may be gone: after a notice the cameras must show its whole volume.

        False after an operator was asked: the way is too late. Raises SkillFailure: PATH_BLOCKED; nothing has moved.
        """
        if self._eyes is None:
            return True
        why = yield from self._eyes.obstructed(True)
        if why:
            yield from ask_operator(self._skill, why)
        return not why

    def begin(self, motion: Motion, times: Float64, q: Float64, holds: bool = False) -> None:
        """Watch a way from now on; until then nothing is compared.

        Args:
            times, q: its postures, shape (n,) on the cell's clock [s] and (n, dof) [rad].
            holds: whether the hand holds a fruit.
        """
        if self._eyes is None:
            return
        t = times - times[0]
        qd = np.gradient(q, t, axis=0)
        way = Trajectory(t, q, qd, np.gradient(qd, t, axis=0))
        led = PlannedMotion(motion, self._skill.clock, float(times[0]), float(times[-1]))
        self._eyes.begin(
            cast(Motion, led), way, full_hand(self._arm.description) if holds else None
        )

    def look(self) -> str | None:
        """Compare new frames with the way; return a text for an obstacle ahead that is not near yet.

        Raises SkillFailure: PATH_BLOCKED and others of `LiveWatch.look`; arm and belt come to rest.
        """
        return None if self._eyes is None else self._eyes.look()


def unseen_people(around: Surroundings, belt: Belt) -> Iterator[Problem]:
    """Yield a warning of a cell that watches its paths, and whose fixed cameras all look past the belt.

    A cell without one has a note of its own: see `pomona.drivers.services.unseen_people`.
    """
    if around.workspace is None or around.workspace.watch is None:
        return
    fixed = {n: said for n, said in around.options.items() if getattr(said, "fixed", None)}
    away = [
        name
        for name, said in fixed.items()
        if belt.pictured(said.intrinsics.intrinsics(), said.fixed.pose())[2].mean() < IN_PICTURE
    ]
    if away and len(away) == len(fixed):
        words = f"'{away[0]}' looks past the belt: no camera sees a person beside or above it while the hand is there"
        yield Problem("driver", words, "fix a camera over the belt", warning=True)


def prepare_reach_watch(skill: Skill) -> None:
    """For `prepare`: the shapes and compiled loops, in a cell whose file requests a watch."""
    prepare_watch(skill)
    if skill.device(Workspace).watch is not None:
        full_hand(skill.device(Arm).description)


@lru_cache(maxsize=4)
def full_hand(description: Path) -> RobotShape:
    """Return a robot whose hand holds a ball as wide as its fingers open, as large as any fruit in it."""
    robot = RobotModel.load(description)
    steps = np.linspace(0.0, np.pi, 9)
    polar, around = (angle.ravel() for angle in np.meshgrid(steps, 2.0 * steps[:-1]))
    ball = np.column_stack(
        (np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar))
    )
    return RobotShape.of(robot).holding(0.5 * robot.width_max * ball)
