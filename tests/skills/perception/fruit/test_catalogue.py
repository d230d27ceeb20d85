"""The catalogue's apple fits the paper's refinement, and bad entries are refused in words."""

import shutil
from pathlib import Path
from zipfile import ZipFile

import jsonschema
import numpy as np
import pytest
import trimesh
import yaml
from hypothesis import given, settings, strategies as st

from pomona.executive.values.findings import Findings
from pomona.skills.perception.fruit import (
    BadFruitFile,
    UnknownFruit,
    catalogue,
    known_fruits,
    load_fruit,
)
from pomona.skills.perception.fruit.catalogue import CATALOGUE, FRUIT_FILES, damage, judge_fruit
from pomona.tools.fruit_kinds.kind_head import kinds_beside
from pomona.tools.training.apple_mesh import AppleShape, apple_mesh, stem_mesh


def test_apple_has_the_deployed_cad_dimensions_and_is_centred() -> None:
    apple = load_fruit("apple")
    assert np.allclose(np.ptp(apple.vertices, axis=0), [0.09756, 0.08539, 0.09590], atol=1e-7)
    assert np.allclose(apple.vertices.min(axis=0) + apple.vertices.max(axis=0), 0.0, atol=1e-7)
    assert apple.vertices.dtype == np.float64
    assert apple.faces.dtype == np.int32


def test_apple_is_watertight_and_faces_outwards() -> None:
    apple = load_fruit("apple")
    mesh = trimesh.Trimesh(apple.vertices, apple.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.0


def test_stem_cavity_lies_on_the_side_the_symmetry_axis_points_to() -> None:
    apple = load_fruit("apple")
    near_axis = np.hypot(apple.vertices[:, 0], apple.vertices[:, 2]) < 0.004
    along = apple.vertices[near_axis] @ apple.symmetry_axis
    half_height = 0.5 * apple.dimensions[1]
    assert along.max() < 0.75 * half_height  # deep cavity at the stem
    assert along.min() < -0.75 * half_height  # shallow basin at the calyx


@pytest.mark.parametrize("name", known_fruits())
def test_every_fruit_of_the_catalogue_loads(name: str) -> None:
    fruit = load_fruit(name)
    assert fruit.name == name
    assert np.isclose(np.linalg.norm(fruit.symmetry_axis), 1.0)


def test_loading_by_folder_and_by_file_gives_the_same_fruit(tmp_path: Path) -> None:
    folder = write_fruit(tmp_path)
    assert load_fruit(folder).name == load_fruit(folder / "fruit.yaml").name == "cube"


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(UnknownFruit, match=r"appel.*apple"):
        load_fruit("appel")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "dimensions: 0.1 0.1 0.2 m",
            r"fruit.yaml:4:13.*the mesh measures 100\.00 100\.00 100\.00 mm",
        ),
        ("dimensions: [0.1, 0.1, 0.1]", "lacks a unit"),
        ("dimensions: 0.1 0.1 m", "a list of 3 numbers"),
        ("dimensions: [1 m, 1 m, .nan]", "is not a length"),
        ("dimensions: -0.1 0.1 0.1 m", "between 1 mm and 1 m"),
        ("dimensions: high", "a list of 3 numbers"),
        ("mesh: gone.ply", "does not exist"),
        ("mesh: fruit.yaml", r"fruit.yaml:4:7.*fruit.yaml is none of .stl, .obj, .ply: export it"),
        ("mesh: noise.ply", "noise.ply is no mesh that can be read"),
        ("mesh: open.ply", "has holes"),
        ("mesh: inside_out.ply", "do not all point outwards"),
        ("mesh: beside.ply", r"fruit.yaml:4:7.*the middle of beside.ply is not its origin"),
        ("symmetry_axis: [0, 0, 0]", "zero vector"),
        ("colour: [2, 0, 0]", "between 0 and 1"),
        ("taste: sweet", r"fruit.yaml:5:1.*no setting 'taste'"),
        ("- a list", "list item stands among keys, below 'symmetry_axis'"),
        ("name: " + "[" * 100 + "]" * 100, "levels deep"),
    ],
)
def test_bad_entries_are_refused_with_the_file_and_the_problem(
    tmp_path: Path, change: str, message: str
) -> None:
    folder = write_fruit(tmp_path, change)
    with pytest.raises(BadFruitFile, match=message):
        load_fruit(folder)


def test_missing_keys_are_named(tmp_path: Path) -> None:
    (tmp_path / "fruit.yaml").write_text("name: plum\n")
    with pytest.raises(
        BadFruitFile, match=r"(?s)needs 'mesh'.*needs 'dimensions'.*needs 'symmetry_axis'"
    ):
        load_fruit(tmp_path)


def test_lemon_is_watertight_and_longer_than_wide() -> None:
    lemon = load_fruit("lemon")
    mesh = trimesh.Trimesh(lemon.vertices, lemon.faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert lemon.dimensions[1] > 1.3 * lemon.dimensions[0]


@pytest.mark.parametrize("name", ["orange", "peach", "pear", "tomato"])
def test_fruit_of_the_kinds_is_a_closed_body_whose_weights_know_it(name: str) -> None:
    fruit = load_fruit(name)
    mesh = trimesh.Trimesh(fruit.vertices, fruit.faces, process=False)
    assert mesh.is_watertight
    assert 0.4 < mesh.volume / fruit.dimensions.prod() < 0.65  # a ball fills π / 6 of its cuboid
    assert fruit.weights is not None
    kinds = kinds_beside(fruit.weights)
    assert kinds is not None
    assert name in kinds.kinds


def test_random_apples_stay_watertight_in_their_cuboid() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = AppleShape(
            lobes=rng.uniform(0, 0.05),
            cavity=rng.uniform(0.6, 1.3),
            basin=rng.uniform(0.5, 1.8),
            belly=rng.uniform(-0.15, 0.15),
            lean=(rng.uniform(-0.08, 0.08), rng.uniform(-0.08, 0.08)),
        )
        vertices, faces = apple_mesh(shape, (0.08, 0.06, 0.07), around=24, rings=16)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        assert mesh.is_watertight
        assert mesh.volume > 0.0
        assert np.allclose(mesh.extents, (0.08, 0.06, 0.07))


def test_stem_rises_towards_minus_y() -> None:
    vertices, faces = stem_mesh()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert vertices[:, 1].min() < -0.5 * 0.08539


def test_every_fruit_file_is_checked_and_described_to_editors(tmp_path: Path) -> None:
    schema = FRUIT_FILES.schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    for name in known_fruits():
        findings = Findings()
        FRUIT_FILES.check(CATALOGUE / name / "fruit.yaml", findings)
        assert findings.sorted() == []
        jsonschema.validate(yaml.safe_load((CATALOGUE / name / "fruit.yaml").read_text()), schema)


def test_damaged_weights_are_found_without_loading_them(tmp_path: Path) -> None:
    weights = load_fruit("apple").weights
    assert weights is not None
    assert damage(weights) == ""
    whole = bytearray(weights.read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    (tmp_path / "flipped.pt").write_bytes(whole)
    (tmp_path / "cut.pt").write_bytes(whole[: len(whole) // 3])
    (tmp_path / "text.pt").write_text("no weights")
    with ZipFile(tmp_path / "packed.pt", "w") as archive:
        archive.writestr("data", b"0")
        archive.infolist()[0].compress_type = 99  # one that nobody knows
    for name in ("flipped.pt", "cut.pt", "text.pt", "none.pt", "packed.pt"):
        assert damage(tmp_path / name)


def test_weights_and_meshes_are_looked_through_once_until_they_change(
    tmp_path: Path, monkeypatch
) -> None:
    folder, looked = tmp_path / "apple", []
    shutil.copytree(CATALOGUE / "apple", folder)
    weights, read = tmp_path / "w.pt", catalogue.read_mesh
    with ZipFile(weights, "w") as archive:
        archive.writestr("data", b"0")
    monkeypatch.setattr(catalogue, "read_mesh", lambda path: looked.append("mesh") or read(path))
    monkeypatch.setattr(
        catalogue, "open_archive", lambda path, _: looked.append("weights") or ZipFile(path)
    )
    for _ in range(3):
        assert load_fruit(folder).name == "apple"
        assert damage(weights) == ""
    assert sorted(looked) == ["mesh", "mesh", "weights"]  # fruit and stem
    weights.write_text("no weights")
    assert damage(weights)


@pytest.mark.parametrize("seed", range(8))
def test_a_surface_is_judged_as_trimesh_judges_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    whole = trimesh.creation.icosphere(subdivisions=1)
    faces = whole.faces.copy()
    if seed % 2:
        faces = np.delete(faces, rng.integers(len(faces)), axis=0)
    if seed % 4 > 1:
        flipped = rng.integers(len(faces))
        faces[flipped] = faces[flipped][::-1].copy()
    if seed > 3:
        faces = faces[:, ::-1]
    seam = whole.vertices[faces].reshape(-1, 3)  # each face with corners of its own
    for vertices, corners in ((whole.vertices, faces), (seam, np.arange(len(seam)).reshape(-1, 3))):
        body = trimesh.Trimesh(vertices, corners, process=True)
        expected = body.is_watertight, body.is_winding_consistent and body.volume > 0.0
        mesh = catalogue.Mesh(np.asarray(vertices), corners.astype(np.int32))
        assert catalogue._surface(mesh) == expected


@settings(max_examples=150)
@given(
    st.integers(0, 120), st.integers(0, 12), st.text("abz:{}[]-0.\"'#&*!|>%@\n\t, é", max_size=4)
)
def test_a_damaged_fruit_file_has_findings_with_places_or_is_a_fruit(
    tmp_path: Path, at: int, length: int, inserted: str
) -> None:
    file = write_fruit(tmp_path) / "fruit.yaml"
    text = file.read_text()
    file.write_text(text[:at] + inserted + text[at + length :])
    findings = Findings()
    said = judge_fruit(file, findings)
    assert said is not None or findings.errors
    assert all(found.line >= 1 and found.column >= 1 for found in findings.sorted())


def write_fruit(folder: Path, change: str = "") -> Path:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    cube.export(folder / "cube.ply")
    trimesh.Trimesh(cube.vertices, cube.faces[1:], process=False).export(folder / "open.ply")
    trimesh.Trimesh(cube.vertices, cube.faces[:, ::-1], process=False).export(
        folder / "inside_out.ply"
    )
    cube.copy().apply_translation((0.0, 0.02, 0.0)).export(folder / "beside.ply")
    (folder / "noise.ply").write_bytes(b"\x00\x01noise")
    entry = {
        "name": "cube",
        "mesh": "cube.ply",
        "dimensions": "0.1 0.1 0.1 m",
        "symmetry_axis": "[0, -1, 0]",
    }
    key = change.partition(":")[0]
    lines = [f"{name}: {value}" for name, value in entry.items() if name != key]
    (folder / "fruit.yaml").write_text("\n".join([*lines, change]) + "\n")
    return folder
