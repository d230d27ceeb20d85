"""Mesh files are judged before a library reads them: format, bytes, triangles, lines, each with both values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from pomona.executive.values import mesh_file
from pomona.executive.values.mesh_file import UnreadableMeshError, read_mesh

PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
FACES = b"element face %d\nproperty list int int vertex_indices\nend_header\n"
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize("suffix", mesh_file.SUFFIXES)
def test_each_format_gives_vertices_and_triangles(tmp_path: Path, suffix: str) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / f"box{suffix}")
    vertices, faces = read_mesh(tmp_path / f"box{suffix}")
    assert np.ptp(vertices, axis=0) == pytest.approx((1.0, 2.0, 3.0))
    assert faces.shape == (12, 3)


def test_a_plain_binary_ply_file_reads_as_trimesh_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=2, radius=0.04).export(path)
    plain = mesh_file._plain_ply(path)
    expected = trimesh.load_mesh(path, process=False)
    assert plain is not None
    assert np.array_equal(plain[0], expected.vertices)
    assert np.array_equal(plain[1], expected.faces)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("mesh.zip", b"PK", r"is none of \.stl, \.obj, \.ply: export it"),
        ("many.stl", bytes(80) + (300_000).to_bytes(4, "little") + bytes(15_000_000), "has 300001 triangles, 200000"),
        ("many.ply", PLY % 4_000_000_000 + FACES % 1, "has 4000000000 elements of one kind, 600000 are read at most"),
        ("faces.ply", PLY % 3 + FACES % 4_000_000_000, "has 4000000000 triangles, 200000 are read at most"),
        ("endless.ply", b"ply\n" + b"comment x\n" * 1000, "no PLY header ends within 4096 bytes"),
        ("lines.obj", TRIANGLE + b"f 1 2 3\n" * 1_600_000, "has 1600003 lines, 1500000 are read at most: simplify it"),
        ("fan.obj", TRIANGLE + b"f" + b" 1 2 3" * 2000 + b"\n", "has 12002 characters in one line, 4096 are"),
        ("corners.obj", TRIANGLE + (b"f" + b" 1 2 3" * 600 + b"\n") * 2000, "has 3600009 numbers, 3000000 are read"),
        ("faces.obj", TRIANGLE + b"f 1 2 3\n" * 200_001, "has 200001 triangles, 200000 are read at most"),
        ("beyond.obj", TRIANGLE + b"f 1 2 9\n", "."),
        ("none.obj", TRIANGLE, "."),
    ],
)  # fmt: skip
def test_a_mesh_that_is_too_large_or_none_is_refused(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableMeshError, match=words):
        read_mesh(tmp_path / name)


def test_a_large_file_is_refused_by_its_size(tmp_path: Path) -> None:
    for suffix, most in mesh_file.MOST_BYTES.items():
        with (tmp_path / f"large{suffix}").open("wb") as stream:
            stream.truncate(most + 1_000_000)
        with pytest.raises(
            UnreadableMeshError, match=r"has \d+ MB, \d+ MB are read at most: simplify it"
        ):
            read_mesh(tmp_path / f"large{suffix}")


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(mesh_file.SUFFIXES),
    st.integers(0, 400),
    st.binary(max_size=6),
    st.integers(0, 6),
)
def test_a_damaged_mesh_is_a_mesh_or_refused(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, at: int, inserted: bytes, length: int
) -> None:
    path = tmp_path_factory.mktemp("mesh") / f"box{suffix}"
    trimesh.creation.box().export(path)
    content = path.read_bytes()
    path.write_bytes(content[:at] + inserted + content[at + length :])
    try:
        vertices, faces = read_mesh(path)
    except UnreadableMeshError:
        return
    assert faces.shape[1] == vertices.shape[1] == 3
    assert faces.min() >= 0
    assert faces.max() < len(vertices)
