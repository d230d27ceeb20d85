"""The robot as planning sees it: kinematics, limits and collision shapes, read from its one description file.

Link 0 is the base; link i moves with joint i. The frame of link i has its origin on joint i's axis and its z along the
axis, so that a joint is one rotation about (or a shift along) its own z: T_base_link[i] = T_base_link[i-1] · step[i] ·
Rz(q[i]). Poses inside the kernels are the upper three rows of a homogeneous matrix, shape (3, 4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import cos, sin
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.executive.values.read_only import ReadOnly
from pomona.executive.values.rotations import is_rigid
from pomona.skills.geometry import inverse
from pomona.skills.motion.robot.description import Body, Description, Geom, read_description
from pomona.skills.motion.robot.errors import BadJoints, BadRobotFile, NotAPose


@kernel(nogil=True)
def forward(steps: Float64, sliding: NDArray[np.bool_], q: Float64, links: Float64) -> None:
    """Write the poses of all links into `links`, shape (dof + 1, 3, 4), for joints q, shape (dof,) [rad or m].

    `steps` (dof, 3, 4) are the poses of the joints in the link before, `sliding` (dof,) marks those that shift.
    """
    for row in range(3):
        for column in range(4):
            links[0, row, column] = 1.0 if row == column else 0.0
    for i in range(q.shape[0]):
        step = steps[i]
        for row in range(3):
            a = links[i, row, 0]
            b = links[i, row, 1]
            c = links[i, row, 2]
            d = links[i, row, 3]
            x = a * step[0, 0] + b * step[1, 0] + c * step[2, 0]
            y = a * step[0, 1] + b * step[1, 1] + c * step[2, 1]
            z = a * step[0, 2] + b * step[1, 2] + c * step[2, 2]
            p = a * step[0, 3] + b * step[1, 3] + c * step[2, 3] + d
            if sliding[i]:
                p += z * q[i]
            (
                links[i + 1, row, 0],
                links[i + 1, row, 1],
                links[i + 1, row, 2],
                links[i + 1, row, 3],
            ) = x, y, z, p
        if not sliding[i]:
            cosine = cos(q[i])
            sine = sin(q[i])
            for row in range(3):
                x = links[i + 1, row, 0]
                y = links[i + 1, row, 1]
                links[i + 1, row, 0] = cosine * x + sine * y
                links[i + 1, row, 1] = cosine * y - sine * x


@kernel(nogil=True)
def compose(T_a_b: Float64, T_b_c: Float64, T_a_c: Float64) -> None:
    """Write T_a_b · T_b_c into T_a_c; all of shape (3, 4)."""
    for row in range(3):
        for column in range(4):
            total = T_a_b[row, 3] if column == 3 else 0.0
            for k in range(3):
                total += T_a_b[row, k] * T_b_c[k, column]
            T_a_c[row, column] = total


@kernel(nogil=True)
def jacobian(links: Float64, sliding: NDArray[np.bool_], p_base: Float64, J: Float64) -> None:
    """Write the geometric Jacobian of a point that moves with the last link into J, shape (6, dof).

    Rows: velocity of the point [m/rad], then angular velocity, both in the base frame.
    """
    for i in range(sliding.shape[0]):
        z0 = links[i + 1, 0, 2]
        z1 = links[i + 1, 1, 2]
        z2 = links[i + 1, 2, 2]
        if sliding[i]:
            J[0, i], J[1, i], J[2, i] = z0, z1, z2
            J[3, i], J[4, i], J[5, i] = 0.0, 0.0, 0.0
        else:
            x = p_base[0] - links[i + 1, 0, 3]
            y = p_base[1] - links[i + 1, 1, 3]
            z = p_base[2] - links[i + 1, 2, 3]
            J[0, i], J[1, i], J[2, i] = z1 * z - z2 * y, z2 * x - z0 * z, z0 * y - z1 * x
            J[3, i], J[4, i], J[5, i] = z0, z1, z2


def last_change(file: Path) -> int:
    """When the file, or another description in its folder that it may include, was changed last [ns]."""
    return max(path.stat().st_mtime_ns for path in (file, *file.parent.glob("*.xml")))


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel(ReadOnly):
    """A serial arm with a gripper. The base frame is the world of its file.

    Attributes:
        path: the file it was read from.
        joint_names: from base to tool.
        lower, upper: position limits, shape (dof,) [rad].
        velocity, acceleration, jerk: limits, shape (dof,); infinite where the file states none.
        T_tool_tcp: pose of the gripper's centre point in the flange frame; identity without a frame "tcp".
        width_min, width_max: range of the gripper's opening [m]; both 0 without a gripper.
        bodies, geoms: collision geometry, see `pomona.skills.motion.robot.description`.
        excluded: pairs of body names that the file excludes from contact.
        endless: which joints turn without limits, shape (dof,).
        steps, sliding: the chain, for the kernels: shapes (dof, 3, 4) and (dof,).
        T_link_tool: pose of the flange in the last link's frame.
        T_link_frame: poses of all named frames on the last link, in its frame.
    """

    path: Path
    joint_names: tuple[str, ...]
    lower: Float64
    upper: Float64
    velocity: Float64
    acceleration: Float64
    jerk: Float64
    T_tool_tcp: Float64
    width_min: float
    width_max: float
    bodies: tuple[Body, ...]
    geoms: tuple[Geom, ...]
    excluded: frozenset[frozenset[str]]
    steps: Float64
    sliding: NDArray[np.bool_]
    T_link_tool: Float64
    T_link_frame: Mapping[str, Float64]
    endless: NDArray[np.bool_]

    @staticmethod
    def load(path: Path | str, tool: str = "tool0", tcp: str = "tcp") -> RobotModel:
        """Read an MJCF or URDF file; a file that has not changed is read once in a process.

        `tool` is the flange, `tcp` the gripper's centre point (z approach, y sliding direction; else the flange): sites
        or bodies.

        Raises:
            BadRobotFile: the file does not compile, or lacks a frame, joint or geometry that is needed.
        """
        file = Path(path).resolve()
        if not file.is_file():
            raise BadRobotFile(file, "there is no such file")
        return _load(file, last_change(file), tool, tcp)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def T_link_tcp(self) -> Float64:
        """Pose of the TCP in the last link's frame, (4, 4) [m]."""
        T: Float64 = self.T_link_tool @ self.T_tool_tcp
        return T

    def frame(self, name: str) -> Float64:
        """T_tool_<name> (4, 4) [m]: a named site or body on the flange (camera, tcp, pad_left …), fingers closed.

        Raises:
            BadRobotFile: the file has no such frame on the last link.
        """
        if name not in self.T_link_frame:
            raise BadRobotFile(self.path, f"has no frame '{name}' on the last link")
        T: Float64 = inverse(self.T_link_tool) @ self.T_link_frame[name]
        return T

    def checked(self, q: ArrayLike) -> Float64:
        """Return joints as a float64 array of its own, shape (dof,); BadJoints: a wrong number, or not finite."""
        try:
            joints = np.array(
                q, dtype=np.float64, order="C"
            )  # the kernels are compiled for arrays that can be written
        except (TypeError, ValueError) as error:
            raise BadJoints(self.joint_names, q, f"{q!r} are no numbers") from error
        if joints.shape != (self.dof,):
            raise BadJoints(self.joint_names, q, f"got an array of shape {joints.shape}")
        if not np.isfinite(joints).all():
            wrong = [
                name
                for name, value in zip(self.joint_names, joints, strict=True)
                if not np.isfinite(value)
            ]
            raise BadJoints(self.joint_names, q, f"{', '.join(wrong)} not finite")
        return joints

    def link_poses(self, q: ArrayLike) -> Float64:
        """T_base_link of the base and all links, shape (dof + 1, 4, 4); frames as above."""
        poses = np.zeros((self.dof + 1, 4, 4))
        links = np.empty((self.dof + 1, 3, 4))
        forward(self.steps, self.sliding, self.checked(q), links)
        poses[:, :3], poses[:, 3, 3] = links, 1.0
        return poses

    def fk(self, q: ArrayLike) -> Float64:
        """T_base_tool0 for joints q, shape (dof,) [rad]."""
        T: Float64 = self.link_poses(q)[-1] @ self.T_link_tool
        return T

    def tcp(self, q: ArrayLike) -> Float64:
        """T_base_tcp for joints q, shape (dof,) [rad]."""
        T: Float64 = self.link_poses(q)[-1] @ self.T_link_tcp
        return T

    def jacobian(self, q: ArrayLike) -> Float64:
        """Geometric Jacobian of the TCP, shape (6, dof): linear velocity, then angular velocity, in the base frame."""
        links = self.link_poses(q)
        J = np.empty((6, self.dof))
        p_base = (links[-1] @ self.T_link_tcp)[:3, 3].copy()
        jacobian(np.ascontiguousarray(links[:, :3]), self.sliding, p_base, J)
        return J

    def manipulability(self, q: ArrayLike) -> float:
        """Yoshikawa's measure sqrt(det(J Jᵀ)) at the TCP; 0 in a singular posture."""
        J = self.jacobian(q)
        return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))


def checked_pose(T: ArrayLike) -> Float64:
    """Return a pose as a contiguous float64 array (4, 4); NotAPose: it is no finite rigid transform."""
    try:
        pose = np.ascontiguousarray(T, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise NotAPose(T) from error
    if not is_rigid(pose, 1e-6):
        raise NotAPose(T)
    return pose


@lru_cache(maxsize=16)
def _load(path: Path, _modified: int, tool: str, tcp: str) -> RobotModel:
    read: Description = read_description(path, tool)
    T_link_tool = read.T_link_frame[tool]
    T_link_tcp = read.T_link_frame.get(tcp, T_link_tool)
    return RobotModel(
        path=path,
        joint_names=read.joint_names,
        lower=read.lower,
        upper=read.upper,
        velocity=read.velocity,
        acceleration=read.acceleration,
        jerk=read.jerk,
        T_tool_tcp=inverse(T_link_tool) @ T_link_tcp,
        width_min=read.width_min,
        width_max=read.width_max,
        bodies=read.bodies,
        geoms=read.geoms,
        excluded=read.excluded,
        steps=np.ascontiguousarray(read.steps[:, :3]),
        sliding=read.sliding,
        T_link_tool=T_link_tool,
        T_link_frame=read.T_link_frame,
        endless=read.endless,
    )
