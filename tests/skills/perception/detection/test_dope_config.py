"""DOPE's config_pose.yaml: contents in SI units, and refused files."""

from pathlib import Path

import numpy as np
import pytest

from pomona.skills.perception.detection.dope_config import load_pose_config
from pomona.skills.perception.detection.errors import BadPoseConfig

PLAIN = """
topic_camera: "/camera/image_raw"
input_is_rectified: True
downscale_height: 400
weights: {"apple": "package://dope/weights/apple.pth", soup: soup.pth}
dimensions: {"apple": [9.756, 8.539, 9.590], soup: [6.7659378051757813, 10.185500144958496, 6.771425724029541]}
class_ids: {"apple": 3}
draw_colors: {"apple": [13, 255, 128]}
model_transforms:
  apple: [[0, 0, 1, 0], [0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]
meshes: {apple: "file:///apple.dae"}
mesh_scales: {apple: 0.01}
thresh_angle: 0.4
thresh_map: 0.02
sigma: 2
thresh_points: 0.2
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "config_pose.yaml"
    path.write_text(text)
    return path


def test_a_plain_file_is_read_in_si_units_and_keys_without_a_use_are_ignored(
    tmp_path: Path,
) -> None:
    config = load_pose_config(write(tmp_path, PLAIN))
    apple = config.objects["apple"]
    assert np.allclose(apple.dimensions, (0.09756, 0.08539, 0.09590))
    assert apple.weights == "package://dope/weights/apple.pth"
    t = config.thresholds
    assert (t.thresh_angle, t.thresh_map, t.sigma, t.thresh_points) == (0.4, 0.02, 2.0, 0.2)
    assert config.downscale_height == 400


def test_thresholds_that_are_not_given_are_dopes(tmp_path: Path) -> None:
    t = load_pose_config(
        write(tmp_path, "weights: {a: a.pth}\ndimensions: {a: [1, 2, 3]}\n")
    ).thresholds
    assert (t.thresh_angle, t.thresh_map, t.sigma, t.thresh_points) == (0.5, 0.01, 3.0, 0.1)


def test_a_file_of_the_newer_tools_names_its_objects_by_their_dimensions(tmp_path: Path) -> None:
    text = "downscale_height: 512\nthresh_points: 0.0\n"
    text += "dimensions: {soup: [6.8, 10.2, 6.8], apple: [9.756, 8.539, 9.590]}\n"
    config = load_pose_config(write(tmp_path, text))
    assert list(config.objects) == ["soup", "apple"]
    assert config.objects["apple"].weights == ""
    assert (config.downscale_height, config.thresholds.thresh_points) == (512, 0.0)


def test_entries_nested_as_ros_parameters_are_found(tmp_path: Path) -> None:
    nested = "dope:\n  ros__parameters:\n    weights: {a: a.pth}\n    dimensions: {a: [1, 2, 3]}\n"
    assert load_pose_config(write(tmp_path, nested)).objects["a"].weights == "a.pth"


ONE = "weights: {a: b}\ndimensions: {a: [1, 2, 3]}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- a\n", "mapping"),
        ("a: [", "cannot be read"),
        ("topic: x\nsigma: 3\n", "names no dimensions of any object"),
        ("weights: {a: b}\nsigma: 3\n", "names no dimensions of any object"),
        ("weights: {a: b}\ndimensions: {c: [1, 2, 3]}\n", "a has weights but no dimensions"),
        ("weights: {a: b}\ndimensions: {a: [1, 2]}\n", "dimensions of a"),
        ("weights: {a: b}\ndimensions: {a: wide}\n", "dimensions of a"),
        (
            "weights: {a: b}\ndimensions: {a: [1, 2, 3]}\nsigma: big\n",
            "sigma must be numbers, not 'big'",
        ),
        (ONE + "sigma: .nan\n", "sigma must be a finite number, not nan"),
        (ONE + "thresh_map:\n", "thresh_map must be a finite number, not None"),
        (ONE + "downscale_height: .inf\n", "downscale_height must be a finite number"),
        (ONE + "downscale_height: 0\n", "downscale_height must be positive"),
        ("weights: [a]\ndimensions: {a: [1, 2, 3]}\n", "must map"),
    ],
)
def test_files_that_cannot_be_used_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BadPoseConfig, match=message):
        load_pose_config(write(tmp_path, text))
