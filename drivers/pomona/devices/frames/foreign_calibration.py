"""Camera calibrations of other programs: whose a file is, and the words that a file of Pomona needs for the same."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
import yaml

from pomona.executive import Float64

OPENCV = re.compile(r"^%YAML:1\.0|!!opencv-matrix")  # OpenCV's own marks, which YAML does not allow
CAMERA = "cam0"  # of a chain of Kalibr's, the first camera

_Size = tuple[float, float]


def foreign_name(keys: Collection[str]) -> str:
    """Return the kind of a foreign calibration by the keys at its top; an empty text for any other file."""
    return next((name for name, needed, _of in FORMATS if set(needed) <= set(keys)), "")


def foreign_calibration(text: str) -> tuple[str, str] | None:
    """Return the kind of a foreign calibration and the words that a file of Pomona needs; None for any other text."""
    try:
        content: Any = next(yaml.safe_load_all(OPENCV.sub("", text)), None)
    except (yaml.YAMLError, RecursionError, ValueError):
        return None
    if not isinstance(content, dict) or not (name := foreign_name(content)):
        return None
    remedy = next(of for known, _needed, of in FORMATS if known == name)
    try:
        return name, remedy(content)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        return name, "a value in it is missing or is no number"


def _intrinsics(
    K: Any, size: _Size, distortion: Any, rectified: Any = None, model: Any = ""
) -> str:
    K, (width, height) = np.asarray(K, np.float64).reshape(3, 3), (int(number) for number in size)
    bent = model in FISHEYE or bool(np.any(np.abs(np.asarray(distortion, np.float64)) > 1e-9))
    if bent and rectified is not None:
        K = np.asarray(rectified, np.float64).reshape(3, 4)[:, :3]
    if not (min(K[0, 0], K[1, 1]) >= 1.0 and 0.0 < K[0, 2] < width and 0.0 < K[1, 2] < height):
        return "its matrix is that of no camera: calibrate it"
    values = ", ".join(
        f"{key}: {K[at]:g} px" for key, at in zip(("fx", "fy", "cx", "cy"), PLACES, strict=True)
    )
    values = f"{{{values}, width: {width}, height: {height}}}"
    where = "into intrinsics.yaml beside the frames, or as 'intrinsics:' of the cell's camera"
    if not bent:
        return f"write {where}: {values}"
    if rectified is not None:
        return f"its lens distorts: rectify the pictures, then write {where}: {values}"
    return f"its lens distorts: rectify the pictures, then write the values of rectified ones {where}; before: {values}"


FISHEYE = (
    "equidistant",
    "fisheye",
    "kannala_brandt",
)  # models of a lens that bends without any coefficient
PLACES = ((0, 0), (1, 1), (0, 2), (1, 2))  # of fx, fy, cx and cy in a camera matrix


def _matrix(fx: float, fy: float, cx: float, cy: float) -> Float64:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _pose(content: Mapping[str, Any]) -> str:
    said = content["parameters"]
    at = content.get("transform", content.get("transformation"))
    x, y, z = (float(at.get("translation", at)[key]) for key in "xyz")
    turn = at.get("rotation", {key: at.get(f"q{key}") for key in "xyzw"})
    q = np.array([float(turn[key]) for key in "wxyz"])
    if not np.isfinite([x, y, z, *q]).all() or abs(np.linalg.norm(q) - 1.0) > 1e-2:
        return "its rotation is no unit quaternion"
    w, i, j, k = q / np.linalg.norm(q)
    rows = [
        [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w), x],
        [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), y],
        [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j), z],
        [0, 0, 0, 1],
    ]
    matrix = ", ".join(f"[{', '.join(f'{round(value, 6):g}' for value in row)}]" for row in rows)
    on_hand = said.get("eye_on_hand", said.get("calibration_type") == "eye_in_hand")
    mount = said["robot_effector_frame"] if on_hand else said["robot_base_frame"]
    camera = f"if {mount} is {'the flange' if on_hand else 'the base'} and {said['tracking_base_frame']} is optical"
    write = (
        f'write {{"T_mount_camera": [{matrix}]}} into a file and name it as the camera\'s hand_eye'
    )
    return f"{write} ({camera}); or repeat it: pomona calibrate hand-eye LOOKS --square 24.5mm --out hand_eye.json"


def _ros(content: Mapping[str, Any]) -> str:
    size = content["image_width"], content["image_height"]
    distortion = content.get("distortion_coefficients", {"data": ()})["data"]
    rectified = content.get("projection_matrix", {}).get("data")
    return _intrinsics(
        content["camera_matrix"]["data"],
        size,
        distortion,
        rectified,
        content.get("distortion_model"),
    )


def _echoed(content: Mapping[str, Any]) -> str:
    values = {key.lower(): value for key, value in content.items()}
    if (
        max(values.get("binning_x", 0), values.get("binning_y", 0)) > 1
        or values.get("roi", {}).get("width", 0) > 0
    ):
        return (
            "it is that of the whole sensor, and the pictures are binned or cut: record whole ones"
        )
    size = values["width"], values["height"]
    return _intrinsics(values["k"], size, values["d"], values.get("p"), values["distortion_model"])


def _kalibr(content: Mapping[str, Any]) -> str:
    camera = content[CAMERA]
    if camera["camera_model"] != "pinhole":
        return f"its model is {camera['camera_model']}: rectify the pictures for a pinhole camera, and take its values"
    K = _matrix(*camera["intrinsics"])
    model = camera.get("distortion_model")
    return _intrinsics(K, camera["resolution"], camera["distortion_coeffs"], model=model)


def _open3d(content: Mapping[str, Any]) -> str:
    K = np.asarray(content["intrinsic_matrix"], np.float64)
    return _intrinsics(
        K.reshape(3, 3).T if K.ndim == 1 else K, (content["width"], content["height"]), ()
    )


def _realsense(content: Mapping[str, Any]) -> str:
    K = _matrix(content["fx"], content["fy"], content["ppx"], content["ppy"])
    return _intrinsics(K, (content["width"], content["height"]), content.get("coeffs", ()))


def _depthai(content: Mapping[str, Any]) -> str:
    del content
    return "take the values of the colour socket at the size of your pictures: getCameraIntrinsics(socket, width, height)"


FORMATS: tuple[tuple[str, tuple[str, ...], Callable[[Mapping[str, Any]], str]], ...] = (
    ("a camera calibration of ROS or OpenCV", ("image_width", "camera_matrix"), _ros),
    ("a CameraInfo of ROS 2", ("distortion_model", "k", "p"), _echoed),
    ("a CameraInfo of ROS 1", ("distortion_model", "K", "P"), _echoed),
    ("a chain of cameras of Kalibr", (CAMERA,), _kalibr),
    ("a hand-eye calibration of easy_handeye", ("parameters", "transformation"), _pose),
    ("a hand-eye calibration of easy_handeye2", ("parameters", "transform"), _pose),
    ("a file of intrinsics of Open3D", ("intrinsic_matrix",), _open3d),
    ("a file of intrinsics of librealsense", ("fx", "ppx"), _realsense),
    ("a calibration of DepthAI", ("cameraData",), _depthai),
)
"""Names, keys at the top by which a file is known, and the function that gives the words for it."""
