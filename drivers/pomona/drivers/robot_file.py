"""Reader of a robot's description file with MuJoCo, with error messages about that file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.errors import UnusableRobotFile
from pomona.drivers.interfaces import ArmLimits
from pomona.drivers.motion_supervisor import Supervision
from pomona.executive.values.installation import installed_trees, load_mujoco
from pomona.executive.values.kinds import PathTo
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.trial import trial

SHIPPED = (installed_trees() / "robots").resolve()  # as trustworthy as the code


def read_spec(path: Path) -> Any:
    """Return the file (MJCF or URDF) as an `mujoco.MjSpec` that compiles.

    A file that is not a shipped one is tried in a process of its own first.

    Raises UnusableRobotFile: it is no XML, names joints, bodies or frames that it does not have, or takes too much time
    or memory.
    """
    if path.is_file() and path.resolve().parent != SHIPPED:
        problem = _tried(path, _changed(path))
        if problem:
            raise UnusableRobotFile(path, problem)
    return _read_spec(path)


def _read_spec(path: Path) -> Any:
    mujoco = load_mujoco()  # takes a moment, and only this needs it
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise UnusableRobotFile(
            path, " ".join(str(error).removeprefix("Error: ").split()) or "cannot be read"
        ) from error
    return spec


def try_robot(path: str) -> None:
    """Compile a file and prepare its simulation; runs in a process of its own. Raises UnusableRobotFile."""
    mujoco = load_mujoco()
    try:
        mujoco.MjData(_read_spec(Path(path)).compile())
    except RuntimeError as error:  # "an unknown exception": a size for which there is no memory
        raise MemoryError from error


@lru_cache(maxsize=8)
def _tried(path: Path, _changed: int) -> str:
    return trial(f"{__name__}:{try_robot.__name__}", str(path))


def _changed(path: Path) -> int:
    """Return when a file, or one beside it that it may include, was changed last [ns]."""
    return max(file.stat().st_mtime_ns for file in (path, *path.parent.glob("*.xml")))


MOST = {"arm_velocity": 50.0, "arm_acceleration": 5e3, "arm_jerk": 1e6}
"""Upper bounds of an arm's limits [rad/s, rad/s², rad/s³]: the quickest small ones turn their wrists at 20 rad/s.
Higher values are in degrees or invalid, and would disable the checks."""
WIDEST = 100.0  # no joint turns further from its zero [rad]: 16 turns


def read_limits(path: Path, dof: int | None = None) -> ArmLimits:
    """Return the ranges of the arm's joints, and the numerics arm_velocity, arm_acceleration and arm_jerk.

    Without `dof` the joints are those of all actuators but the gripper's.

    Raises UnusableRobotFile: the file cannot be read, has fewer joints, or lacks one of the numerics.
    """
    return _limits(path, dof, _changed(path) if path.is_file() else 0)


@lru_cache(maxsize=8)
def _limits(path: Path, dof: int | None, _changed: int) -> ArmLimits:
    model = read_spec(path).compile()
    arm = [i for i in range(model.nu) if model.actuator(i).name != "gripper"]
    count = len(arm) if dof is None else dof
    joints = np.sort(model.actuator_trnid[arm, 0])[
        :count
    ]  # from base to tool, whatever the order of the actuators
    if len(joints) < count:
        raise UnusableRobotFile(path, f"has {len(joints)} actuated joints, the arm has {count}")
    rates = []
    for name, most in MOST.items():
        try:
            rate = np.array(model.numeric(name).data, dtype=np.float64)
        except KeyError as error:
            raise UnusableRobotFile(path, f"<custom> lacks the numeric '{name}'") from error
        if rate.shape != (count,) or not np.all((rate > 0.0) & (rate <= most)):
            words = (
                f"'{name}' needs {count} positive numbers up to {most:g}, in radians and seconds"
            )
            raise UnusableRobotFile(path, words)
        rates.append(rate)
    ranges = np.array(model.jnt_range[joints], dtype=np.float64)
    for joint, (lower, upper) in zip(joints, ranges, strict=True):
        if not -WIDEST <= lower < upper <= WIDEST:
            words = f"the joint '{model.joint(joint).name}' needs a range; {lower:g} … {upper:g} rad is none"
            raise UnusableRobotFile(path, words)
    return ArmLimits(ranges[:, 0], ranges[:, 1], *rates)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFile:
    """Options that each arm has which is sent set-points."""

    robot: Path = value(
        PathTo("file"), help="the robot's description (MJCF or URDF), with its limits"
    )
    supervision: Supervision = value(
        Section(Supervision), Supervision(), "how closely the arm must follow its commands"
    )

    @property
    def dof(self) -> int:
        """Joints that the description must have."""
        return 6

    @property
    def limits(self) -> ArmLimits:
        """Limits of the joints. Raises UnusableRobotFile."""
        return read_limits(self.robot, self.dof)

    def problems(self) -> Iterator[Problem]:
        try:
            read_limits(self.robot, self.dof)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))

    def known(self) -> Iterator[object]:
        yield self.limits
