"""Detect with anyone's boxes: poses by the close look and by depth, against the truth of a rendered frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.detect import Detect
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.detection.close_look import REFERENCE_LENGTH
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.box_detectors.box_detector import NoSphere, sphere_in_box
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import RenderedFrame, render_scene
from tests.skills.tools.box_detectors.onnx_boxes import write

OPTIONS = SceneOptions(kinds=(1, 0, 0, 0), instances=(2, 2), distractors=0)
INTRINSICS = Intrinsics(*OPTIONS.camera, 640, 480)
T_BASE_CAMERA = transform(rotation_about((1.0, 0.0, 0.0), np.pi), (0.0, -0.4, 0.6))


@pytest.fixture(scope="module")
def scene() -> RenderedFrame:
    """A table with two whole apples."""
    rendered = render_scene(load_fruit("apple"), OPTIONS, 31_000_007)
    assert min(truth.visibility for truth in rendered.fruit) > 0.9
    return rendered


class Shown:
    """A camera that shows one frame."""

    def __init__(self, frame: Frame) -> None:
        self._frame = frame

    def latest(self) -> Frame:
        return self._frame


def detect(scene: RenderedFrame, model: Path, with_depth: bool = True, **inputs: Any) -> SkillEnd:
    depth = scene.depth if with_depth else None
    frame = Frame(0.0, 0, scene.colour, depth, INTRINSICS, None, T_BASE_CAMERA)
    wired: Mapping[str, Any] = {"fruit": "apple", "boxes": str(model), "target": "surest", **inputs}
    return drive(Detect(), wired, devices={Camera: Shown(frame)})


def boxes_of(scene: RenderedFrame, path: Path) -> Path:
    """A torchvision-style model that gives the true boxes, in its input of half the picture's width."""
    x, y, w, h = (0.5 * np.array([truth.box for truth in scene.fruit], float)).T
    return write(
        path, {"boxes": np.column_stack([x, y, x + w, y + h]), "scores": [0.9, 0.8]}, [3, 240, 320]
    )


@pytest.mark.parametrize("pose", ["close_look", "depth"])
def test_fruit_in_anyones_boxes_is_posed_where_it_is(
    scene: RenderedFrame, tmp_path: Path, pose: str
) -> None:
    model = boxes_of(scene, tmp_path / "model.onnx")
    for index, truth in enumerate(scene.fruit):
        outcome = detect(scene, model, pose_from=pose, index=index)
        assert outcome.status is Status.SUCCESS
        found = outcome.outputs["detection"]
        assert found.score == pytest.approx(0.9 - 0.1 * index)
        assert found.found == 2
        p, true = found.T_camera_object[:3, 3], truth.T_camera_object[:3, 3]
        across = np.linalg.norm(np.cross(p, true)) / np.linalg.norm(p)
        assert across < 6e-3
        # The CAD-sized model seems as large as the fruit: its distance tells the apparent size.
        size, true_size = REFERENCE_LENGTH / p[2], truth.scale * REFERENCE_LENGTH / true[2]
        assert size == pytest.approx(true_size, rel=0.1)
        assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_a_box_without_depth_has_no_pose(scene: RenderedFrame, tmp_path: Path) -> None:
    outcome = detect(
        scene, boxes_of(scene, tmp_path / "model.onnx"), with_depth=False, pose_from="depth"
    )
    assert outcome.reason is not None
    assert outcome.reason.code == "POSE_UNSOLVED"
    assert outcome.reason.message == "the frame has no depth, which pose_from: depth needs"


def test_a_box_on_the_table_is_no_fruit(scene: RenderedFrame, tmp_path: Path) -> None:
    model = write(
        tmp_path / "model.onnx", {"boxes": [[0, 150, 320, 240]], "scores": [0.9]}, [3, 240, 320]
    )
    outcome = detect(scene, model, pose_from="depth")
    assert outcome.reason is not None
    assert outcome.reason.code == "POSE_UNSOLVED"
    assert "expected" in outcome.reason.message


def test_a_model_that_cannot_be_used_is_a_failure_in_one_line(
    scene: RenderedFrame, tmp_path: Path
) -> None:
    model = write(tmp_path / "model.onnx", {"logits": [[1.0]]})
    outcome = detect(scene, model)
    assert outcome.reason is not None
    assert outcome.reason.code == "NO_WEIGHTS"
    assert (
        "model.onnx: has the outputs logits (1, 1), expected one output" in outcome.reason.message
    )


def test_check_names_wrong_wires(tmp_path: Path) -> None:
    config = tmp_path / "config_pose.yaml"
    config.write_text("dimensions: {apple: [9.756, 8.539, 9.590]}\n")
    known = {
        "fruit": "apple",
        "boxes": "none.onnx",
        "config": str(config),
        "weights": "",
        "pose_from": "depth",
    }
    problems = {problem.key: problem.message for problem in Detect.judge(known, None)}
    assert problems["boxes"] == "there is no file none.onnx"
    assert problems["config"] == "it goes with DOPE's weights, not with boxes: none.onnx"
    known = {"fruit": "apple", "boxes": "", "config": str(tmp_path / "none.yaml"), "weights": ""}
    texts = [problem.message for problem in Detect.judge(known, None)]
    assert any("none.yaml: cannot be read" in text for text in texts)
    assert any("needs the weights that it configures" in text for text in texts)
    config.write_text("dimensions: {soup: [6.8, 10.2, 6.8]}\n")
    known = {"fruit": "apple", "config": str(config), "weights": str(config)}
    (problem,) = Detect.judge(known, None)
    assert "soup is 6.8 × 10.2 × 6.8 cm, the mesh of apple" in problem.message


K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
RADII = 0.015, 0.08


def ball(centre: np.ndarray, radius: float, behind: float = 0.9) -> np.ndarray:
    """Depth of a sphere before a wall."""
    v, u = np.mgrid[:480, :640]
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=2)
    a, b = (rays**2).sum(axis=2), rays @ centre
    inside = b**2 - a * (centre @ centre - radius**2)
    return np.where(inside > 0.0, (b - np.sqrt(np.maximum(inside, 0.0))) / a, behind).astype(
        np.float32
    )


def box_of(depth: np.ndarray, behind: float = 0.9) -> np.ndarray:
    v, u = np.nonzero(depth < behind - 1e-3)
    return np.array([u.min(), v.min(), u.max() - u.min() + 1, v.max() - v.min() + 1], float)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.5), (0.15, -0.1, 0.4), (-0.2, 0.12, 0.7)])
@pytest.mark.parametrize("radius", [0.025, 0.045])
def test_a_sphere_in_sight_is_found_to_a_millimetre(
    centre: tuple[float, float, float], radius: float
) -> None:
    depth = ball(np.array(centre), radius)
    noisy = depth * (1.0 + np.random.default_rng(0).normal(0.0, 2e-3, depth.shape)).astype(
        np.float32
    )
    found = sphere_in_box(noisy, K, box_of(depth), RADII)
    assert np.linalg.norm(found.centre - centre) < 2e-3
    assert found.radius == pytest.approx(radius, rel=0.05)
    assert found.seen > 0.8


def test_a_half_covered_sphere_keeps_its_centre(tmp_path: object) -> None:
    centre = np.array([0.05, 0.02, 0.5])
    depth = ball(centre, 0.045)
    x, y, w, h = box_of(depth)
    half = np.array([x, y, 0.5 * w, h])
    depth[:, int(x + 0.5 * w) :] = 0.3  # a leaf before its right half
    found = sphere_in_box(depth, K, half, RADII)
    assert np.linalg.norm(found.centre - centre) < 6e-3
    assert 0.3 < found.seen < 0.6


@pytest.mark.parametrize("missing", [0.0, np.nan])
def test_holes_in_the_depth_are_left_out(missing: float) -> None:
    centre = np.array([0.0, 0.0, 0.5])
    depth = ball(centre, 0.045)
    depth[::2] = missing
    assert (
        np.linalg.norm(sphere_in_box(depth, K, box_of(ball(centre, 0.045)), RADII).centre - centre)
        < 2e-3
    )


def test_an_implausible_shape_is_refused_with_both_values() -> None:
    box = np.array([280.0, 200.0, 80.0, 80.0])
    with pytest.raises(NoSphere, match=r"depth at 0 pixels of the box, expected at least 40"):
        sphere_in_box(np.zeros((480, 640), np.float32), K, box, RADII)
    steps = np.full((480, 640), 0.5, np.float32)
    steps[:, ::2] = 0.53
    with pytest.raises(NoSphere, match=r"% of the depth in the box is a sphere's, expected 50 %"):
        sphere_in_box(steps, K, box, RADII)
    depth = ball(np.array([0.0, 0.0, 0.5]), 0.045)
    with pytest.raises(
        NoSphere, match=r"a sphere (89|90|91) mm wide in the box, expected 20 to 60 mm"
    ):
        sphere_in_box(depth, K, box_of(depth), (0.01, 0.03))


def test_a_box_beyond_the_border_has_no_depth() -> None:
    with pytest.raises(NoSphere, match="depth at 0 pixels"):
        sphere_in_box(
            np.full((480, 640), 0.5, np.float32), K, np.array([700.0, 10.0, 30.0, 30.0]), RADII
        )
