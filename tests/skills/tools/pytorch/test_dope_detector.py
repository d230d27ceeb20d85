"""A DOPE user's weights and config: maps drawn where a cuboid is, and every file that does not fit."""

from pathlib import Path

import numpy as np
import pytest
import torch
from py_trees.common import Status

from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.executive.skill_testing import drive
from pomona.skills.detect import Detect
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.detection.detection import DopeFiles
from pomona.skills.perception.detection.dope_config import load_pose_config
from pomona.skills.perception.detection.errors import BadPoseConfig, BadWeights
from pomona.skills.perception.detection.instances import cuboid_keypoints
from pomona.tools.pytorch import dope_detector
from pomona.tools.pytorch.dope_decode import OFFSET_DUE_TO_UPSAMPLING
from pomona.tools.pytorch.dope_detector import DopeDetector
from pomona.tools.pytorch.networks import STRIDE, DopeNetwork

pytestmark = pytest.mark.slow

APPLE = (0.09756, 0.08539, 0.09590)
CONFIG = "weights: {{apple: epoch_60.pth}}\ndimensions: {{apple: {cm}}}\ndownscale_height: 240\n"
K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])


def write_config(folder: Path, cm: str = "[9.756, 8.539, 9.590]") -> Path:
    path = folder / "config_pose.yaml"
    path.write_text(CONFIG.format(cm=cm))
    return path


def drawn_maps(cells: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Belief (9, h, w) and affinity (16, h, w) of one object whose keypoints (9, 2) lie at these cells."""
    v, u = np.mgrid[:height, :width]
    away = np.hypot(u - cells[:, 0, None, None], v - cells[:, 1, None, None])
    towards = cells[8] - cells[:8]
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    affinity = towards[:, :, None, None] * (away[:8, None] <= 2.0)
    return np.exp(-0.5 * away**2).astype("f4"), affinity.reshape(16, height, width).astype("f4")


class Drawn(DopeNetwork):
    """Returns the maps of a perfect network for one cuboid in a picture shrunk by a half."""

    def __init__(self, keypoints: np.ndarray) -> None:
        torch.nn.Module.__init__(self)
        cells = 0.5 * keypoints / STRIDE - OFFSET_DUE_TO_UPSAMPLING
        self.maps = [torch.from_numpy(maps[None]) for maps in drawn_maps(cells, 30, 40)]
        self.seen: list[torch.Size] = []

    def forward(self, x: torch.Tensor) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        self.seen.append(x.shape)
        return [self.maps[0]], [self.maps[1]]


@pytest.mark.slow
def test_a_cuboid_is_found_where_it_is_at_the_configs_scale(tmp_path: Path) -> None:
    T = transform(
        rotation_about((0.0, 1.0, 0.0), 0.4) @ rotation_about((1.0, 0.0, 0.0), 0.6),
        (0.03, -0.02, 0.35),
    )
    corners = cuboid_keypoints(APPLE) @ T[:3, :3].T + T[:3, 3]
    keypoints = corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + K[:2, 2]
    network = Drawn(keypoints)
    detector = DopeDetector(network, load_pose_config(write_config(tmp_path)), np.array(APPLE))
    (found,) = detector.find_instances(np.zeros((480, 640, 3), np.uint8), K)
    assert network.seen == [torch.Size((1, 3, 240, 320))]
    assert found.T_camera_object is not None
    assert np.linalg.norm(found.T_camera_object[:3, 3] - T[:3, 3]) < 0.02
    assert np.abs(found.keypoints - keypoints).max() < 5.0
    assert found.score > 0.5
    assert found.visibility == 1.0


@pytest.mark.slow
def test_detect_poses_a_fruit_with_a_users_checkpoint_and_config(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From files in the form of DOPE's own tools to a Detection; the network alone is drawn."""
    T = transform(rotation_about((1.0, 0.0, 0.0), 0.6), (0.03, -0.02, 0.35))
    corners = cuboid_keypoints(APPLE) @ T[:3, :3].T + T[:3, 3]
    network = Drawn(corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + K[:2, 2])
    loaded: list[Path] = []
    monkeypatch.setattr(dope_detector, "load_weights", lambda path: loaded.append(path) or network)
    config = tmp_path / "config_pose.yaml"
    config.write_text(
        "input_is_rectified: True\ndownscale_height: 240\n"
        'dimensions: {"003_soup": [6.77, 10.19, 6.77], "apple": [9.756, 8.539, 9.590]}\n'
        'class_ids: {"003_soup": 1, "apple": 2}\ndraw_colors: {"apple": [0x76, 0xb9, 0x00]}\n'
        "thresh_angle: 0.5\nthresh_map: 0.01\nsigma: 3\nthresh_points: 0.0\n"
    )
    intrinsics = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
    frame = Frame(0.0, 0, np.zeros((480, 640, 3), np.uint8), None, intrinsics, None, np.eye(4))
    camera = type("Shown", (), {"latest": lambda _self: frame})()
    weights = tmp_path / "epoch_60.pth"
    wired = {"fruit": "apple", "weights": str(weights), "config": str(config), "score": 0.5}
    outcome = drive(Detect(), wired, devices={Camera: camera})
    assert outcome.status is Status.SUCCESS
    assert loaded == [weights]
    detection = outcome.outputs["detection"]
    assert np.linalg.norm(detection.T_camera_object[:3, 3] - T[:3, 3]) < 0.02
    assert detection.covariance.shape == (6, 6)


@pytest.mark.slow
def test_a_checkpoint_is_loaded_with_the_config_that_goes_with_it(tmp_path: Path) -> None:
    torch.manual_seed(0)
    weights = tmp_path / "epoch_60.pth"
    torch.save(
        {f"module.{key}": value for key, value in DopeNetwork().state_dict().items()}, weights
    )
    detector = DopeDetector.load(DopeFiles(weights, write_config(tmp_path)), "apple", None, APPLE)
    instances = detector.find_instances(np.zeros((64, 96, 3), np.uint8), K)
    assert all(0.0 <= one.score <= 1.0 and np.isfinite(one.keypoints).all() for one in instances)


def test_files_that_do_not_fit_are_refused_in_words(tmp_path: Path) -> None:
    config = write_config(tmp_path)
    with pytest.raises(BadWeights, match=r"none\.pth: no such file"):
        DopeDetector.load(DopeFiles(tmp_path / "none.pth", config), "apple", None, APPLE)
    with pytest.raises(
        BadPoseConfig,
        match=r"apple is 9\.8 × 8\.5 × 9\.6 cm, the mesh of lemon 9\.0 × 6\.0 × 6\.0 cm",
    ):
        DopeDetector.load(
            DopeFiles(tmp_path / "none.pth", config), "lemon", None, (0.09, 0.06, 0.06)
        )
    two = tmp_path / "two.yaml"
    two.write_text("weights: {a: a.pth, b: b.pth}\ndimensions: {a: [1, 2, 3], b: [1, 2, 3]}\n")
    with pytest.raises(BadPoseConfig, match="configures a, b, not apple"):
        DopeDetector.load(DopeFiles(tmp_path / "none.pth", two), "apple", None, APPLE)
