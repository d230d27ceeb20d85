"""ONNX Runtime finds the same as PyTorch, with the same weights."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings, strategies as st
from onnx import TensorProto, helper, load_model_from_string, numpy_helper

from pomona.skills.perception.detection import compact_detector
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_runtime import (
    INPUT,
    MOST_NODES,
    BadGraph,
    judge_layers,
    judge_model,
    onnx_network,
)
from pomona.skills.perception.detection.weights_file import (
    FINDER,
    MOST_BYTES,
    StoredDetector,
    read_weights,
    write_weights,
)
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.fruit.catalogue import SHIPPED_WEIGHTS
from pomona.tools.box_detectors.box_model import BoxModel, load_boxes
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import render_scene
from pomona.tools.training.torch_engine import torch_detector

pytestmark = pytest.mark.slow

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])

TASKS = Path("/proc/self/task")


@pytest.mark.slow
def test_both_engines_find_the_same_fruit_with_the_shipped_parameters(tmp_path: Path) -> None:
    shipped = SHIPPED_WEIGHTS / "apple_photographs.weights"
    colour = render_scene(load_fruit("apple"), SceneOptions(kinds=(1, 0, 0, 0)), 31_000_003).colour
    networks, scores = load_compact(shipped), read_weights(shipped).scores
    by_torch = torch_detector(*networks)
    by_torch.scores = scores
    expected = by_torch.find(colour, K)
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


def in_float32(content: bytes) -> bytes:
    """Return a rounded network without its rounding: the parameters are still in the file."""
    model = load_model_from_string(content)
    layers = []
    for node in model.graph.node:
        if node.output[0].endswith((".ratio", ".whole", ".integer", ".rounded")):
            continue
        given = [name.removesuffix(".rounded") for name in node.input]
        del node.input[:]
        node.input.extend(given)
        layers.append(node)
    del model.graph.node[:]
    model.graph.node.extend(layers)
    return bytes(model.SerializeToString())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["apple", "lemon"])
def test_layers_in_eight_bits_move_detections_by_less_than_their_errors(
    name: str, tmp_path: Path
) -> None:
    fruit = load_fruit(name)
    assert fruit.weights is not None
    colour = render_scene(fruit, SceneOptions(kinds=(1, 0, 0, 0)), 31_000_003).colour
    stored = read_weights(fruit.weights)
    networks = {name: in_float32(getattr(stored, name)) for name in ("finder", "close_look")}
    write_weights(tmp_path / "float32.weights", replace(stored, **networks))
    expected = CompactDetector.load(tmp_path / "float32.weights").find(colour, K)
    found = CompactDetector.load(fruit.weights).find(colour, K)
    # Of fruit that the border cuts, size is known less well.
    clear = [
        one
        for one in expected
        if one.score > 0.6 and one.box is not None and (one.box[:2] > 4.0).all()
    ]
    clear = [one for one in clear if (one.box[:2] + one.box[2:] < (636.0, 476.0)).all()]
    assert len(clear) >= 2
    for one in clear:
        same = min(found, key=lambda other: float(np.linalg.norm(other.centre - one.centre)))
        assert same.score == pytest.approx(one.score, abs=0.1)
        assert same.centre == pytest.approx(one.centre, abs=0.5)
        # Depth follows the size, whose median error is 2 %.
        assert np.linalg.norm(same.p_camera - one.p_camera) < 0.01 * one.p_camera[2]


@pytest.mark.slow
def test_both_engines_give_the_same_maps_at_any_size(tmp_path: Path) -> None:
    torch.manual_seed(0)
    save_compact(tmp_path / "small.weights", FinderNetwork(), CloseLookNetwork((8, 8, 8, 8, 8)))
    detector = CompactDetector.load(tmp_path / "small.weights")
    # Of another size than the one with which the graph was traced.
    picture = np.random.default_rng(0).integers(0, 256, (96, 160, 3), dtype=np.uint8)
    maps, _ = detector.maps(picture)
    expected, _ = torch_detector(*load_compact(tmp_path / "small.weights")).maps(picture)
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
    environment = {
        name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"
    }
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run(
        [sys.executable, "-c", "import pomona.skills.perception.detection.onnx_runtime"],
        env=environment,
        check=True,
    )
    assert list(tmp_path.rglob("*onnxruntime*")) == []


def test_graphs_that_are_none_are_refused_in_words(tmp_path: Path) -> None:
    apple = load_fruit("apple")
    assert apple.weights is not None
    stored = read_weights(apple.weights)
    path = tmp_path / "cut.weights"
    write_weights(
        path, StoredDetector(stored.finder[:1000], stored.close_look, stored.about, stored.scores)
    )
    with pytest.raises(
        BadWeights, match=r"cut\.weights: finder\.onnx in it cannot be read as ONNX"
    ):
        CompactDetector.load(path)
    other = stored.finder.replace(b"picture", b"drawing")
    with pytest.raises(BadWeights, match=r"has the inputs \['drawing'\], expected \['picture'\]"):
        onnx_network(other, path, FINDER)


FLOAT = TensorProto.FLOAT
SHIPPED = read_weights(SHIPPED_WEIGHTS / "apple.weights")


def constant(name: str, value: Any, dtype: Any = np.int64) -> Any:
    return helper.make_node(
        "Constant", [], [name], value=numpy_helper.from_array(np.asarray(value, dtype))
    )


def value(name: str, kind: int = FLOAT, shape: list[int] | None = None) -> Any:
    return helper.make_tensor_value_info(name, kind, shape)


def network(*nodes: Any, functions: tuple[Any, ...] = ()) -> bytes:
    """A graph from the picture to `maps`."""
    picture = helper.make_tensor_value_info(INPUT, FLOAT, ["n", 3, "h", "w"])
    domains = [helper.make_opsetid("", 18), *(helper.make_opsetid(f.domain, 1) for f in functions)]
    graph = helper.make_graph(list(nodes), "g", [picture], [value("maps")])
    model = helper.make_model(graph, opset_imports=domains, functions=list(functions), ir_version=9)
    return bytes(model.SerializeToString())


def loop(output: str = "maps") -> Any:
    """A node that never ends."""
    same = [
        helper.make_node("Identity", ["go"], ["on"]),
        helper.make_node("Identity", ["x"], ["y"]),
    ]
    inputs = [value("i", TensorProto.INT64, []), value("go", TensorProto.BOOL, []), value("x")]
    body = helper.make_graph(same, "b", inputs, [value("on", TensorProto.BOOL, []), value("y")])
    return helper.make_node("Loop", ["", "true", INPUT], [output], body=body)


def choice() -> Any:
    """An `If` around the loop."""
    one = helper.make_graph([loop("q")], "one", [], [value("q")])
    other = helper.make_graph(
        [helper.make_node("Identity", [INPUT], ["r"])], "other", [], [value("r")]
    )
    return helper.make_node("If", ["true"], ["maps"], then_branch=one, else_branch=other)


TRUE = constant("true", True, np.bool_)
TWICE = helper.make_function(
    "own",
    "twice",
    ["x"],
    ["y"],
    [helper.make_node("Relu", ["x"], ["y"])],
    [helper.make_opsetid("", 18)],
)
ENDLESS = {
    "a loop": (network(TRUE, loop()), "has the operator 'Loop'"),
    "a loop in a choice": (network(TRUE, choice()), "has the operator '(If|Loop)'"),
    "a function": (network(helper.make_node("twice", [INPUT], ["maps"], domain="own"), functions=(TWICE,)), "defines"),
    "many nodes": (network(*(helper.make_node("Relu", [INPUT], [str(k)]) for k in range(MOST_NODES + 1))), "has more"),
}  # fmt: skip


@pytest.mark.parametrize("name", ENDLESS)
def test_a_graph_without_an_end_is_refused_before_it_is_loaded(name: str, tmp_path: Path) -> None:
    content, words = ENDLESS[name]
    with pytest.raises(BadGraph, match=words):
        judge_layers(content, INPUT)
    with pytest.raises(BadGraph, match=words):
        judge_model(content)
    write_weights(
        tmp_path / "x.weights", StoredDetector(content, SHIPPED.close_look, {}, SHIPPED.scores)
    )
    with pytest.raises(BadWeights, match=rf"x\.weights: finder\.onnx in it {words}"):
        CompactDetector.load(tmp_path / "x.weights")
    (tmp_path / "x.onnx").write_bytes(content)
    with pytest.raises(BadWeights, match=rf"x\.onnx: {words}"):
        BoxModel(tmp_path / "x.onnx", "apple")


def test_a_size_that_follows_from_the_picture_is_refused() -> None:
    bright = helper.make_node("ReduceMean", [INPUT], ["bright"], keepdims=1)
    size = helper.make_node("Cast", ["bright"], ["size"], to=TensorProto.INT64)
    grown = helper.make_node("Expand", [INPUT, "size"], ["maps"])
    with pytest.raises(BadGraph, match="computes a size of its operator 'Expand' from the picture"):
        judge_layers(network(bright, size, grown), INPUT)
    with pytest.raises(BadGraph, match="lists a node before one whose result it takes"):
        judge_layers(network(grown, bright, size), INPUT)
    shape = helper.make_node("Shape", [INPUT], ["size"])
    judge_layers(network(shape, grown), INPUT)


@pytest.mark.parametrize("name", ["apple", "lemon", "apple_photographs"])
def test_the_shipped_networks_would_be_loaded_from_elsewhere_too(name: str) -> None:
    stored = read_weights(SHIPPED_WEIGHTS / f"{name}.weights")
    for content in (stored.finder, stored.close_look):
        judge_layers(content, INPUT)
        judge_model(content)


def twofold() -> bytes:
    names = [INPUT, *(f"c{k}" for k in range(1, 14)), "maps"]
    pairs = pairwise(names)
    return network(*(helper.make_node("Concat", [a, a], [b], axis=1) for a, b in pairs))


def slow() -> bytes:
    first, kernel = np.zeros((64, 3, 9, 9)), np.zeros((64, 64, 9, 9))
    names = ["x", *(f"x{k}" for k in range(200)), "maps"]
    nodes = [constant("first", first, np.float32), constant("kernel", kernel, np.float32)]
    nodes.append(helper.make_node("Conv", [INPUT, "first"], ["x"], pads=[4] * 4))
    pairs = pairwise(names)
    nodes += [helper.make_node("Conv", [a, "kernel"], [b], pads=[4] * 4) for a, b in pairs]
    return network(*nodes)


@pytest.mark.parametrize(
    ("finder", "words"),
    [
        (twofold, r"needs more than 512 MB of memory"),
        (slow, r"takes more than 4 s of processor time"),
    ],
)
@pytest.mark.slow
def test_a_network_that_is_too_large_ends_in_its_trial(
    finder: Callable[[], bytes], words: str, tmp_path: Path
) -> None:
    path = tmp_path / "x.weights"
    write_weights(path, StoredDetector(finder(), SHIPPED.close_look, {}, SHIPPED.scores))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with pytest.raises(BadWeights, match=rf"x\.weights: {words}"):
        CompactDetector.load(path)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 10.0
    assert after.ru_maxrss < max(
        1_000_000, before.ru_maxrss + 1
    )  # the largest of all children so far


def test_a_detector_of_boxes_that_is_too_large_ends_in_its_trial(tmp_path: Path) -> None:
    path = tmp_path / "x.onnx"
    path.write_bytes(twofold())
    with pytest.raises(BadWeights, match="needs more than 512 MB of memory"):
        load_boxes(path, "apple")


def test_weights_that_unpack_to_more_than_a_detector_has_are_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "x.weights"
    write_weights(path, StoredDetector(bytes(MOST_BYTES), SHIPPED.close_look, {}, SHIPPED.scores))
    assert path.stat().st_size < 8_000_000
    with pytest.raises(
        BadWeights, match=r"x\.weights: unpacks to 72 MB; 67 MB are read at most: no weights"
    ):
        read_weights(path)


def test_shipped_weights_start_without_a_trial_and_others_with_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []
    monkeypatch.setattr(
        compact_detector, "trial", lambda *arguments: tried.append(arguments[1]) or ""
    )
    CompactDetector.load(SHIPPED_WEIGHTS / "apple.weights")
    assert tried == []
    write_weights(tmp_path / "mine.weights", SHIPPED)
    CompactDetector.load(tmp_path / "mine.weights")
    assert tried == [str(tmp_path / "mine.weights")]


SMALL = network(constant("k", [0.5], np.float32), helper.make_node("Mul", [INPUT, "k"], ["maps"]))


@settings(max_examples=300, deadline=None)
@given(st.integers(0, len(SMALL) - 1), st.binary(max_size=8), st.integers(0, 8))
def test_a_damaged_graph_is_judged_or_refused(at: int, inserted: bytes, length: int) -> None:
    content = SMALL[:at] + inserted + SMALL[at + length :]
    for judge in (lambda: judge_layers(content, INPUT), lambda: judge_model(content)):
        with contextlib.suppress(BadGraph):
            judge()


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=60))
def test_any_bytes_are_judged_or_refused(content: bytes) -> None:
    with contextlib.suppress(BadGraph):
        judge_layers(content, INPUT)
