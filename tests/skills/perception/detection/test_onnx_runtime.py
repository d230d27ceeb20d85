"""ONNX files of the detector's networks: ONNX Runtime finds with them what torch finds."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.compact_network import CloseLookNetwork, FinderNetwork
from pomona.skills.perception.detection.errors import BadWeights, MissingPackage
from pomona.skills.perception.detection.onnx_runtime import export_onnx, load_onnx
from pomona.skills.perception.detection.weights import load_compact, save_compact
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.synthetic.options import SceneOptions
from pomona.skills.perception.synthetic.scene import render_scene

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    folder = tmp_path_factory.mktemp("apple_onnx")
    weights = load_fruit("apple").weights
    assert weights is not None
    export_onnx(weights, folder)
    return folder


def test_onnx_runtime_finds_the_same_fruit(exported: Path) -> None:
    apple = load_fruit("apple")
    assert apple.weights is not None
    colour = render_scene(apple, SceneOptions(kinds=(1, 0, 0, 0)), 31_000_003).colour
    finder, close_look, _ = load_compact(apple.weights)  # in float32, whatever this processor is fastest with
    expected = CompactDetector.running(finder, close_look).find(colour, K)
    found = load_onnx(exported).find(colour, K)
    assert len(found) == len(expected) > 3
    for one, other in zip(found, expected, strict=True):
        assert one.score == pytest.approx(other.score, abs=1e-3)
        assert one.centre == pytest.approx(other.centre, abs=0.02)
        assert one.p_camera == pytest.approx(other.p_camera, abs=1e-4)
        assert np.degrees(np.arccos(min(1.0, float(one.stem @ other.stem)))) < 0.5  # processors round differently


def test_a_finder_that_knows_boxes_says_them_through_onnx_too(tmp_path: Path) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    torch.manual_seed(0)
    save_compact(tmp_path / "small.pt", FinderNetwork((8, 8, 8, 8)), CloseLookNetwork((8, 8, 8, 8, 8)))
    export_onnx(tmp_path / "small.pt", tmp_path / "onnx")
    finder, close_look, _ = load_compact(tmp_path / "small.pt")
    # Of another size than the graph was drawn up with.
    picture = np.random.default_rng(0).integers(0, 256, (96, 160, 3), dtype=np.uint8)
    maps, _ = load_onnx(tmp_path / "onnx")._maps(picture)
    expected, _ = CompactDetector.running(finder, close_look)._maps(picture)
    assert [part.shape for part in maps] == [part.shape for part in expected]
    assert len(maps) == 3
    for one, other in zip(maps, expected, strict=True):
        assert one == pytest.approx(other, abs=1e-3)


def test_files_that_are_none_are_refused_in_words(exported: Path, tmp_path: Path) -> None:
    with pytest.raises(BadWeights, match=r"finder\.onnx: no such file: `pomona export-weights --onnx` writes it"):
        load_onnx(tmp_path)
    (tmp_path / "finder.onnx").write_bytes((exported / "finder.onnx").read_bytes()[:1000])
    with pytest.raises(BadWeights, match=r"finder\.onnx: cannot be read as an ONNX file"):
        load_onnx(tmp_path)


def test_a_missing_package_is_named_with_how_to_get_it() -> None:
    error = MissingPackage("onnxruntime", "carries out ONNX files")
    assert str(error) == "onnxruntime carries out ONNX files and is not installed: pip install 'pomona[onnx]'"
