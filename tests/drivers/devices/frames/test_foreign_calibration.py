"""Calibrations of other programs: named, and rewritten for Pomona."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.frames.folder import read_intrinsics
from pomona.devices.frames.foreign_calibration import foreign_calibration
from pomona.devices.realsense.mounted_camera import read_hand_eye
from pomona.executive import CellFileError

K = "615.25, 0.0, 318.5, 0.0, 615.75, 241.25, 0.0, 0.0, 1.0"
P = "610.0, 0.0, 320.0, 0.0, 0.0, 612.0, 240.5, 0.0, 0.0, 0.0, 1.0, 0.0"
PLAIN = "{fx: 615.25 px, fy: 615.75 px, cx: 318.5 px, cy: 241.25 px, width: 640, height: 480}"
RECTIFIED = "{fx: 610 px, fy: 612 px, cx: 320 px, cy: 240.5 px, width: 640, height: 480}"

ROS = f"""image_width: 640
image_height: 480
camera_matrix: {{rows: 3, cols: 3, data: [{K}]}}
distortion_coefficients: {{rows: 1, cols: 5, data: [DISTORTION]}}
projection_matrix: {{rows: 3, cols: 4, data: [{P}]}}
"""
ECHO = f"height: 480\nwidth: 640\ndistortion_model: plumb_bob\nd: [0.0]\nk: [{K}]\np: [{P}]\n---\n"
OPENCV = f"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {K} ]
"""
KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [DISTORTION]
  intrinsics: [615.25, 615.75, 318.5, 241.25]
  resolution: [640, 480]
"""
OPEN3D = '{"width": 640, "height": 480, "intrinsic_matrix": [615.25, 0, 0, 0, 615.75, 0, 318.5, 241.25, 1]}'
REALSENSE = '{"width": 640, "height": 480, "fx": 615.25, "fy": 615.75, "ppx": 318.5, "ppy": 241.25, "coeffs": [0, 0]}'


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        (ROS.replace("DISTORTION", "0.0"), "ROS or OpenCV", PLAIN),
        (ROS.replace("DISTORTION", "0.1, -0.2"), "ROS or OpenCV", RECTIFIED),
        (ECHO, "CameraInfo of ROS 2", PLAIN),
        (
            ECHO.replace("k:", "K:").replace("p:", "P:").replace("d:", "D:"),
            "CameraInfo of ROS 1",
            PLAIN,
        ),
        (OPENCV, "ROS or OpenCV", PLAIN),
        (KALIBR.replace("DISTORTION", "0.0"), "Kalibr", PLAIN),
        (OPEN3D, "Open3D", PLAIN),
        (REALSENSE, "librealsense", PLAIN),
    ],
)
def test_the_values_that_it_gives_are_a_file_of_intrinsics(
    tmp_path: Path, text: str, name: str, values: str
) -> None:
    path = tmp_path / "intrinsics.yaml"
    path.write_text(text)
    with pytest.raises(CellFileError) as refused:
        read_intrinsics(path)
    assert name in refused.value.message
    assert values in refused.value.hint
    path.write_text(values)
    assert read_intrinsics(path).width == 640


def test_a_lens_that_distorts_is_named() -> None:
    found = foreign_calibration(KALIBR.replace("DISTORTION", "-0.28, 0.07, 0.0, 0.0"))
    assert found is not None
    assert "rectify the pictures, then write the values of rectified ones" in found[1]


NONE, CUT = "its matrix is that of no camera", "the pictures are binned or cut"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROS.replace("DISTORTION", "0.0") + "distortion_model: equidistant\n", RECTIFIED),
        (
            KALIBR.replace("DISTORTION", "0, 0, 0, 0") + "  distortion_model: equidistant\n",
            "its lens distorts",
        ),
        (
            KALIBR.replace("pinhole", "eucm"),
            "its model is eucm: rectify the pictures for a pinhole camera",
        ),
        (ROS.replace("615.25", ".nan").replace("DISTORTION", "0.0"), NONE),
        (ECHO.replace("615.25", "0.0"), NONE),
        (OPENCV.replace("0.0, 318.5, 0.0", "0.0, 0.0, 0.0").replace("241.25", "0.0"), NONE),
        (ECHO.replace("---", "binning_x: 2\nbinning_y: 2"), CUT),
        (ECHO.replace("---", "roi: {x_offset: 9, y_offset: 0, width: 300, height: 200}"), CUT),
        (ECHO.replace("---", "binning_x: 0\nroi: {width: 0, height: 0}"), PLAIN),
    ],
)
def test_values_are_given_only_where_they_hold(text: str, words: str) -> None:
    found = foreign_calibration(text)
    assert found is not None
    assert words in found[1]
    assert ("{fx:" in found[1]) == (words in (PLAIN, RECTIFIED, "its lens distorts"))


@pytest.mark.parametrize("on_hand", [True, False])
def test_a_pose_of_easy_handeye_becomes_the_file_of_a_camera(tmp_path: Path, on_hand: bool) -> None:
    found = foreign_calibration(f"""parameters:
  eye_on_hand: {str(on_hand).lower()}
  robot_base_frame: base_link
  robot_effector_frame: flange_7
  tracking_base_frame: camera_optical
transformation: {{x: 0.1, y: -0.2, z: 0.3, qx: 0.0, qy: 0.0, qz: 0.70711, qw: 0.70711}}
""")
    assert found is not None
    assert f"if {'flange_7 is the flange' if on_hand else 'base_link is the base'}" in found[1]
    matrix, _end = json.JSONDecoder().raw_decode(found[1].removeprefix("write "))
    path = tmp_path / "hand_eye.json"
    path.write_text(json.dumps(matrix))
    T = read_hand_eye(path)
    np.testing.assert_allclose(T @ [1.0, 0.0, 0.0, 1.0], [0.1, 0.8, 0.3, 1.0], atol=1e-5)


@pytest.mark.parametrize("values", ["", "qx: 0, qy: 0, qz: 0, qw: 2, x: 0, y: 0, z: 0", "x: a"])
def test_a_pose_that_is_none_gives_no_matrix(values: str) -> None:
    found = foreign_calibration(f"parameters: {{}}\ntransformation: {{{values}}}\n")
    assert found is not None
    assert "T_mount_camera" not in found[1]


@pytest.mark.parametrize(
    "text", ["", "fx: 600 px", "[1, 2]", "a: [", "tree: t\nparameters: {a: 1}\nroot: {}"]
)
def test_any_other_text_is_left_to_its_own_reader(text: str) -> None:
    assert foreign_calibration(text) is None
