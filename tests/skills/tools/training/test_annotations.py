"""Annotation files in DOPE's format, both ways."""

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.detection.errors import BadAnnotation
from pomona.tools.training.annotations import (
    AnnotatedObject,
    Annotation,
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


def test_eight_points_and_a_centroid_are_read_too(tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    corners = [[float(i), float(2 * i)] for i in range(8)]
    entry = {"class": "apple", "projected_cuboid": corners, "projected_cuboid_centroid": [3.0, 9.0]}
    path.write_text(json.dumps({"objects": [entry]}))
    points = read_annotation(path).objects[0].keypoints
    assert np.array_equal(points, [*corners, [3.0, 9.0]])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"objects": [{"class": "a", "projected_cuboid": [[1, 2]]}]}',
        '{"objects": 3}',
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(BadAnnotation, match=r"bad\.json"):
        read_annotation(path)


@pytest.mark.parametrize("corners", [True, False])
def test_centimetres_are_noticed_and_metres_kept(tmp_path: Path, corners: bool) -> None:
    flat = [[float(i), float(i)] for i in range(9)]
    near = np.array([0.03, -0.02, 0.55])
    cuboid = [(near + 0.04 * np.array(sign)).tolist() for sign in np.ndindex(2, 2, 2)]
    for factor in (1.0, 100.0):
        entry = {"class": "apple", "projected_cuboid": flat, "location": (factor * near).tolist()}
        if corners:
            entry["cuboid"] = (factor * np.array(cuboid)).tolist()
        path = tmp_path / f"{factor:.0f}.json"
        path.write_text(json.dumps({"objects": [entry]}))
        assert read_annotation(path).objects[0].T_camera_object[:3, 3] == pytest.approx(near)


def test_a_far_object_in_metres_is_known_by_its_cuboid(tmp_path: Path) -> None:
    path, far = tmp_path / "far.json", [0.0, 1.0, 14.0]
    cuboid = [[u, 1.0 + v, 14.0 + w] for u, v, w in np.ndindex(2, 2, 2)]
    entry = {
        "class": "car",
        "projected_cuboid": [[0.0, 0.0]] * 9,
        "location": far,
        "cuboid": cuboid,
    }
    path.write_text(json.dumps({"objects": [entry]}))
    assert read_annotation(path).objects[0].T_camera_object[:3, 3].tolist() == far


def test_a_camera_of_the_whole_folder_is_read_where_a_frame_names_none(tmp_path: Path) -> None:
    (tmp_path / "000001.json").write_text('{"objects": []}')
    assert read_annotation(tmp_path / "000001.json").width == 0
    intrinsics = {"fx": 610.0, "fy": 611.0, "cx": 320.0, "cy": 240.0}
    settings = {
        "intrinsic_settings": intrinsics,
        "captured_image_size": {"width": 640, "height": 480},
    }
    (tmp_path / "_camera_settings.json").write_text(json.dumps({"camera_settings": [settings]}))
    read = read_annotation(tmp_path / "000001.json")
    assert (read.width, read.height, read.camera) == (640, 480, (610.0, 611.0, 320.0, 240.0))
    (tmp_path / "_camera_settings.json").write_text("{}")
    with pytest.raises(BadAnnotation, match=r"000001\.json"):
        read_annotation(tmp_path / "000001.json")
