"""Meshes of a scene: read, refused with a remedy, and cut into parts that contain them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pomona.drivers import workspace
from pomona.drivers.errors import UnusableMesh
from pomona.drivers.interfaces import Hull
from pomona.drivers.workspace import read_parts
from pomona.executive.values import mesh_file

POINT = b"""solid p
facet normal 0 0 1
outer loop
vertex 1 1 1
vertex 1 1 1
vertex 1 1 1
endloop
endfacet
endsolid p
"""


def written(folder: Path, mesh: trimesh.Trimesh, name: str = "shelf.stl") -> Path:
    path = folder / name
    mesh.export(path)
    return path


def bracket(scale: float = 1.0) -> trimesh.Trimesh:
    """Two boxes that meet in an L, as one mesh of two bodies."""
    flat = trimesh.creation.box((0.4, 0.2, 0.02))
    upright = trimesh.creation.box(
        (0.02, 0.2, 0.4), trimesh.transformations.translation_matrix((-0.3, 0.0, 0.2))
    )
    both = trimesh.util.concatenate([flat, upright])
    both.apply_scale(scale)
    return both


@pytest.mark.parametrize("name", ["shelf.stl", "shelf.obj", "shelf.ply"])
def test_each_body_is_a_part_of_its_own(tmp_path: Path, name: str) -> None:
    parts = read_parts(written(tmp_path, bracket(), name))
    sizes = sorted(tuple(np.ptp(part.points, axis=0).round(4)) for part in parts)
    assert sizes == [(0.02, 0.2, 0.4), (0.4, 0.2, 0.02)]
    assert all(np.allclose(np.linalg.norm(part.normals, axis=1), 1.0) for part in parts)


def test_millimetres_are_read_as_such(tmp_path: Path) -> None:
    (whole,) = read_parts(written(tmp_path, trimesh.creation.box((400.0, 300.0, 20.0))), unit=1e-3)
    np.testing.assert_allclose(np.ptp(whole.points, axis=0), [0.4, 0.3, 0.02])


def test_cut_finely_the_parts_leave_a_hollow_free_and_contain_the_surface(tmp_path: Path) -> None:
    ring = trimesh.creation.annulus(r_min=0.20, r_max=0.22, height=0.05)
    path = written(tmp_path, ring)
    (whole,) = read_parts(path)
    parts = read_parts(path, detail=0.06)
    assert len(parts) > 12

    def inside(points: np.ndarray, part: Hull) -> np.ndarray:
        return np.all(
            points @ part.normals.T <= (part.points @ part.normals.T).max(axis=0) + 1e-9, axis=1
        )

    surface = ring.sample(2000, seed=3)
    assert np.any([inside(surface, part) for part in parts], axis=0).all()
    assert inside(np.zeros((1, 3)), whole).all()
    assert all(np.linalg.norm(part.points[:, :2].mean(axis=0)) > 0.15 for part in parts)
    assert max(np.ptp(part.points, axis=0).max() for part in parts) < 2.5 * 0.06


@pytest.mark.parametrize(
    ("scale", "unit", "says"),
    [
        (1000.0, 1.0, "400 x 200 x 410 m large: if it is in millimetres, write `unit: mm`"),
        (1.0, 1e-6, "if it is in metres, write `unit: m`"),
    ],
)
def test_a_mesh_in_another_unit_is_refused_with_its_size(
    tmp_path: Path, scale: float, unit: float, says: str
) -> None:
    mesh = trimesh.creation.box((0.4 * scale, 0.2 * scale, 0.41 * scale))
    with pytest.raises(UnusableMesh) as refused:
        read_parts(written(tmp_path, mesh), unit)
    assert says in str(refused.value)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.stl", b""),
        ("words.stl", b"solid nothing\nendsolid nothing\n"),
        ("noise.stl", bytes(range(256)) * 3),
        ("cut.stl", b"\0" * 80 + (50).to_bytes(4, "little") + b"\0" * 49),
        ("empty.obj", b"# nothing\n"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("beyond.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("empty.ply", b"ply\n"),
        ("point.stl", POINT),
        ("scene.glb", b"glTF"),
    ],
)  # fmt: skip
def test_a_file_without_a_mesh_is_refused_and_breaks_nothing(
    tmp_path: Path, name: str, content: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    for detail in (None, 0.05):
        with pytest.raises(UnusableMesh):
            read_parts(path, detail=detail)


def test_too_many_parts_and_triangles_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, trimesh.creation.box((2.0, 2.0, 2.0)))
    with pytest.raises(UnusableMesh, match="coarser `detail`"):
        read_parts(path, detail=0.05)
    with pytest.raises(UnusableMesh, match="coarser `detail`"):
        read_parts(path, detail=0.005)
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 11)
    workspace._parts.cache_clear()
    with pytest.raises(UnusableMesh, match="simplify it"):
        read_parts(path)


def test_a_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, trimesh.creation.box((0.4, 0.2, 0.1)))
    read_parts(path)
    path = written(tmp_path, bracket())
    assert len(read_parts(path)) == 2
