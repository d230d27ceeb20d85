"""Check of the camera's given pose."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import ArmState, Frame
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import angle_between
from pomona.skills.motion.occupancy.errors import CameraPoseMismatch
from pomona.skills.motion.robot import RobotModel

_DISTANCE, _ANGLE = 2e-3, 5e-3  # between two statements about one pose [m, rad]


def pose_of_camera(frame: Frame, model: RobotModel) -> Float64:
    """T_base_camera (4, 4) [m] of a frame: by forward kinematics on the arm, else its mount's pose in the base frame.

    Raises BadJoints: the frame's joints are none of this arm.
    """
    if frame.q is None:
        return frame.T_mount_camera
    T: Float64 = model.fk(frame.q) @ frame.T_mount_camera
    return T


def check_camera_pose(frame: Frame, T_base_camera: Float64, model: RobotModel, arm: ArmState) -> None:
    """Compare a camera pose with the frame's joints, and these with an arm that stands still.

    Raises CameraPoseMismatch, BadJoints: they contradict each other, or are none of this arm.
    """
    T_base_expected = pose_of_camera(frame, model)
    distance = float(np.linalg.norm(T_base_camera[:3, 3] - T_base_expected[:3, 3]))
    angle = angle_between(T_base_expected[:3, :3], T_base_camera[:3, :3])
    if not (distance <= _DISTANCE and angle <= _ANGLE):
        raise CameraPoseMismatch(
            f"it is {1e3 * distance:.1f} mm and {np.degrees(angle):.2f}° from the pose that the frame's joints give",
            distance,
            angle,
        )
    if frame.q is None or arm.moving or abs(arm.stamp - frame.stamp) > 0.05:  # [s]
        return
    off = float(np.max(np.abs(model.checked(frame.q) - arm.q)))
    if not off <= 0.02:  # between the joints at the exposure and those of an arm that stands still [rad]
        raise CameraPoseMismatch(f"the frame's joints are {off:.3f} rad from those of the resting arm")
