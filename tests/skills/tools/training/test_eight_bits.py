"""Rounding a weights file to eight bits: nearly the same answers, and parameters that can be learnt on."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch

from pomona.skills.perception.detection.onnx_runtime import onnx_network
from pomona.skills.perception.detection.weights_file import StoredDetector, read_weights
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.pytorch.weights import load_compact, save_compact
from pomona.tools.training.eight_bits import round_weights

pytestmark = pytest.mark.slow

K = np.array([[160.0, 0.0, 80.0], [0.0, 160.0, 48.0], [0.0, 0.0, 1.0]])

Both = tuple[Path, StoredDetector, StoredDetector]
"""A rounded weights file, and its content before and after."""


@pytest.fixture(scope="module")
def both(tmp_path_factory: Any) -> Both:
    """Untaught networks; the finder proposes no place."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("rounded") / "small.weights"
    save_compact(path, FinderNetwork(), CloseLookNetwork((8, 8, 8, 8, 8)))
    before = read_weights(path)
    rng = np.random.default_rng(0)
    round_weights(path, [(rng.integers(0, 256, (96, 160, 3), dtype=np.uint8), K) for _ in range(2)])
    return path, before, read_weights(path)


@pytest.mark.slow
def test_rounded_networks_answer_nearly_the_same(both: Both) -> None:
    _, before, after = both
    picture = np.random.default_rng(1).random((1, 3, 128, 160), np.float32) - 0.5
    expected, maps = (onnx_network(stored.finder, "", "")(picture)[0] for stored in (before, after))
    errors = np.abs(maps - expected).mean(axis=(0, 2, 3))
    assert 0.0 < errors.max() < 0.1 * np.std(expected, axis=(0, 2, 3)).max()


@pytest.mark.slow
def test_parameters_stay_in_the_file_as_they_were(both: Both) -> None:
    path, before, _ = both
    again = path.with_name("again.weights")
    save_compact(again, *load_compact(path))
    assert read_weights(again).members() == before.members()


@pytest.mark.slow
def test_ends_keep_float32(both: Both) -> None:
    _, _, after = both
    for content, last in (
        (after.finder, 2),
        (after.close_look, 0),
    ):  # the close look's last two are no convolutions
        layers = [
            node
            for node in onnx.load_model_from_string(content).graph.node
            if node.op_type == "Conv"
        ]
        rounded = [node.input[1].endswith(".rounded") for node in layers]
        assert rounded == [False] + [True] * (len(layers) - 1 - last) + [False] * last


@pytest.mark.slow
def test_weights_have_seven_bits(both: Both) -> None:
    """Sums of two products of an unsigned byte and a weight stay in 16 bits, without saturation."""
    _, _, after = both
    model = onnx.load_model_from_string(after.close_look)
    integers = [
        node.output[0]
        for node in model.graph.node
        if node.op_type == "QuantizeLinear" and node.attribute
    ]
    model.graph.output.extend(onnx.helper.make_empty_tensor_value_info(name) for name in integers)
    values = onnx_network(model.SerializeToString(), "", "")(np.zeros((1, 3, 96, 96), np.float32))[
        1:
    ]
    assert max(int(np.abs(value.astype(int)).max()) for value in values) == 64
