"""Annotation files in DOPE's format, both ways."""

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.skills.geometry import rotation_about, transform
from pomona.tools.training.annotations import (
    AnnotatedObject,
    Annotation,
    BadTraining,
    read_annotation,
    write_annotation,
)


def sample(angle: float = 0.7) -> Annotation:
    T = transform(rotation_about(np.array([1.0, 2.0, -2.0]) / 3.0, angle), (0.1, -0.05, 0.6))
    points = np.random.default_rng(0).uniform(0, 400, (9, 2))
    fruit = AnnotatedObject(
        "apple", 0.8, T, points, 0.9, np.array([0.08, 0.07, 0.08]), (10, 20, 30, 40)
    )
    return Annotation(640, 480, (610.6, 610.6, 317.7, 238.1), (fruit,), ((5.0, 6.0, 7.0),), "table")


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5, np.pi])
def test_written_values_are_read_back(tmp_path: Path, angle: float) -> None:
    path = tmp_path / "000001.json"
    written = sample(angle)
    write_annotation(path, written)
    read = read_annotation(path)
    assert (read.width, read.height, read.camera, read.decoys, read.scene) == (
        written.width,
        written.height,
        written.camera,
        written.decoys,
        written.scene,
    )
    before, after = written.objects[0], read.objects[0]
    assert np.allclose(after.T_camera_object, before.T_camera_object, atol=1e-5)
    assert np.allclose(after.keypoints, before.keypoints, atol=1e-3)
    assert (after.name, after.visibility, after.scale, after.box) == (
        "apple",
        0.8,
        0.9,
        (10, 20, 30, 40),
    )


def test_files_carry_the_keys_that_dopes_tools_read(tmp_path: Path) -> None:
    path = tmp_path / "000001.json"
    write_annotation(path, sample())
    content = json.loads(path.read_text())
    entry = content["objects"][0]
    assert {
        "class",
        "visibility",
        "location",
        "quaternion_xyzw",
        "projected_cuboid",
    } <= entry.keys()
    assert np.shape(entry["projected_cuboid"]) == (9, 2)
    assert np.isclose(np.linalg.norm(entry["quaternion_xyzw"]), 1.0, atol=1e-5)
    assert content["camera_data"]["intrinsics"]["fx"] == 610.6


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"objects": [{"class": "a", "projected_cuboid": [[1, 2]]}]}',
        '{"objects": 3}',
        '{"camera_data": {}, "objects": [], "decoys": [], "scene": ""}',
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(BadTraining, match=r"bad\.json: is no frame of `pomona data detect`"):
        read_annotation(path)
