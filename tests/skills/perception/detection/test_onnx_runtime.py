"""ONNX Runtime finds the same as PyTorch, with the same weights."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.compact_network import BeliefFinder, CloseLookNetwork
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.finder_network import FinderNetwork
from pomona.skills.perception.detection.onnx_runtime import onnx_network
from pomona.skills.perception.detection.weights import load_compact, save_compact
from pomona.skills.perception.detection.weights_file import FINDER, StoredDetector, read_weights, write_weights
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import render_scene
from pomona.tools.training.torch_engine import torch_detector

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])

TASKS = Path("/proc/self/task")


@pytest.mark.parametrize("name", ["apple", "lemon"])
def test_both_engines_find_the_same_fruit_with_the_shipped_parameters(name: str, tmp_path: Path) -> None:
    fruit = load_fruit(name)
    assert fruit.weights is not None
    colour = render_scene(fruit, SceneOptions(kinds=(1, 0, 0, 0)), 31_000_003).colour
    networks, scores = load_compact(fruit.weights)[:2], read_weights(fruit.weights).scores
    expected = torch_detector(*networks, scores=scores).find(colour, K)
    save_compact(tmp_path / "float32.weights", *networks, scores=scores)
    found = CompactDetector.load(tmp_path / "float32.weights").find(colour, K)
    assert len(found) == len(expected) > 2
    for one, other in zip(found, expected, strict=True):
        assert one.score == pytest.approx(other.score, abs=5e-3)
        assert one.centre == pytest.approx(other.centre, abs=0.02)
        assert one.p_camera == pytest.approx(other.p_camera, abs=1e-4)
        # The second look is centred by the first, and a picture is sampled in steps of 1/32 px.
        assert one.stem == pytest.approx(other.stem, abs=2e-3)
        assert one.spreads == pytest.approx(other.spreads, rel=1e-2)
        assert one.visibility == pytest.approx(other.visibility, abs=1e-3)


@pytest.mark.parametrize("name", ["apple", "lemon"])
def test_layers_in_eight_bits_move_detections_by_less_than_their_errors(name: str, tmp_path: Path) -> None:
    fruit = load_fruit(name)
    assert fruit.weights is not None
    colour = render_scene(fruit, SceneOptions(kinds=(1, 0, 0, 0)), 31_000_003).colour
    save_compact(
        tmp_path / "float32.weights", *load_compact(fruit.weights)[:2], scores=read_weights(fruit.weights).scores
    )
    expected = CompactDetector.load(tmp_path / "float32.weights").find(colour, K)
    found = CompactDetector.load(fruit.weights).find(colour, K)
    # Of fruit that the border cuts, size is known less well.
    clear = [one for one in expected if one.score > 0.6 and one.box is not None and (one.box[:2] > 4.0).all()]
    clear = [one for one in clear if (one.box[:2] + one.box[2:] < (636.0, 476.0)).all()]
    assert len(clear) >= 2
    for one in clear:
        same = min(found, key=lambda other: float(np.linalg.norm(other.centre - one.centre)))
        assert same.score == pytest.approx(one.score, abs=0.1)
        assert same.centre == pytest.approx(one.centre, abs=0.5)
        # Depth follows the size, whose median error is 2 %.
        assert np.linalg.norm(same.p_camera - one.p_camera) < 0.01 * one.p_camera[2]


@pytest.mark.parametrize("finder", [FinderNetwork, BeliefFinder, lambda: BeliefFinder(boxes=False)])
def test_both_engines_give_the_same_maps_at_any_size(
    finder: Callable[[], FinderNetwork | BeliefFinder], tmp_path: Path
) -> None:
    torch.manual_seed(0)
    save_compact(tmp_path / "small.weights", finder(), CloseLookNetwork((8, 8, 8, 8, 8)))
    detector = CompactDetector.load(tmp_path / "small.weights")
    # Of another size than the one with which the graph was traced.
    picture = np.random.default_rng(0).integers(0, 256, (96, 160, 3), dtype=np.uint8)
    maps, _ = detector._maps(picture)
    expected, _ = torch_detector(*load_compact(tmp_path / "small.weights")[:2])._maps(picture)
    assert maps.shape == expected.shape == (6, 48, 80)
    assert maps == pytest.approx(expected, abs=1e-3)


@pytest.mark.skipif(not TASKS.is_dir(), reason="this system does not list a process's threads")
def test_a_network_runs_in_the_callers_thread() -> None:
    """Two threads of an engine, on a busy machine, wait for each other longer than they work."""
    apple = load_fruit("apple")
    assert apple.weights is not None
    before = len(list(TASKS.iterdir()))
    network = onnx_network(read_weights(apple.weights).finder, apple.weights, FINDER)
    network(np.zeros((1, 3, 96, 96), np.float32))
    assert len(list(TASKS.iterdir())) == before


def test_the_runtime_leaves_no_telemetry_in_the_users_cache(tmp_path: Path) -> None:
    """By default it writes a database there."""
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run(
        [sys.executable, "-c", "import pomona.skills.perception.detection.onnx_runtime"], env=environment, check=True
    )
    assert list(tmp_path.rglob("*onnxruntime*")) == []


def test_graphs_that_are_none_are_refused_in_words(tmp_path: Path) -> None:
    apple = load_fruit("apple")
    assert apple.weights is not None
    stored = read_weights(apple.weights)
    path = tmp_path / "cut.weights"
    write_weights(path, StoredDetector(stored.finder[:1000], stored.close_look, stored.about, stored.scores))
    with pytest.raises(BadWeights, match=r"cut\.weights: finder\.onnx in it cannot be read as ONNX"):
        CompactDetector.load(path)
    other = stored.finder.replace(b"picture", b"drawing")
    with pytest.raises(BadWeights, match=r"has the inputs \['drawing'\], expected \['picture'\]"):
        onnx_network(other, path, FINDER)
