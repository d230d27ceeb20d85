"""Rounds layers of a weights file to eight bits: ONNX Runtime's integer kernels take half the time or less.

Parameters stay in the file in half precision under their names, so that training goes on from it. The graph holds the
scales, and ONNX Runtime folds the rounding of parameters when it loads the graph. The first and the last layers keep
float32: rounded, they move keypoints by 1.3 px (3.1 to 4.4 px of 63 apples).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx.helper import make_empty_tensor_value_info, make_node
from onnx.numpy_helper import from_array

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.onnx_runtime import INPUT, open_session
from pomona.skills.perception.detection.weights_file import read_weights, write_weights

# layers at both ends of a network that keep float32
FIRST = 1
LAST = 2
LARGEST_WEIGHT = 64  # weights have seven bits: products of eight bits saturate on processors with AVX2 and without VNNI
RECTIFIERS = "Relu", "Clip"  # operations that are done by the layer before them


def round_weights(path: Path, pictures: Iterable[tuple[UInt8, Float64]]) -> None:
    """Round both networks of a weights file, with the ranges of values that pictures cause.

    Args:
        path: rewritten.
        pictures: RGB (h, w, 3) and camera matrix (3, 3) [px] of each.
    """
    stored = read_weights(path)
    finder = _Rounding(stored.finder)
    close_look = _Rounding(stored.close_look)
    detector = CompactDetector(finder, close_look, scores=stored.scores)
    detector.warm_up()  # both networks run, whatever the pictures hold
    for colour, K in pictures:
        detector.find(colour, K)
    write_weights(path, replace(stored, finder=finder.rounded(), close_look=close_look.rounded()))


class _Rounding:
    """A network that records the ranges of its values while it runs."""

    def __init__(self, content: bytes) -> None:
        self._model = onnx.load_model_from_string(content)
        nodes = self._model.graph.node
        moving = {INPUT}  # values that depend on the picture
        users: dict[str, list[Any]] = {}
        for node in nodes:
            if moving.intersection(node.input):
                moving.update(node.output)
            for name in node.input:
                users.setdefault(name, []).append(node)

        def rectified(name: str) -> str:
            after = users.get(name, [])
            return (
                rectified(after[0].output[0])
                if len(after) == 1 and after[0].op_type in RECTIFIERS
                else name
            )

        layers = [
            node for node in nodes if node.op_type in ("Conv", "Gemm") and node.input[0] in moving
        ]
        self._layers = {
            node.output[0]: node for node in layers[FIRST:-LAST] if node.op_type == "Conv"
        }
        values: dict[str, None] = {}
        for node in nodes:
            read = [name for name in node.input if name in moving]
            if node.output[0] in self._layers:
                values |= dict.fromkeys((read[0], rectified(node.output[0])))
            elif (
                node.op_type in ("Add", "Resize") and read and all(name in values for name in read)
            ):
                values[rectified(node.output[0])] = None
        self._ranges = {name: np.zeros(2) for name in values}
        probe = onnx.ModelProto()
        probe.CopyFrom(self._model)
        wanted = [*values, *(node.input[1] for node in self._layers.values())]
        probe.graph.output.extend(make_empty_tensor_value_info(name) for name in wanted)
        self._probe = open_session(probe.SerializeToString())
        self._names = [self._model.graph.output[0].name, *wanted]
        self._weights: dict[str, Float32] = {}

    def __call__(self, pictures: Float32) -> list[Float32]:
        outputs = dict(
            zip(self._names, self._probe.run(self._names, {INPUT: pictures}), strict=True)
        )
        for name, bounds in self._ranges.items():
            bounds[:] = min(bounds[0], outputs[name].min()), max(bounds[1], outputs[name].max())
        self._weights = {node.input[1]: outputs[node.input[1]] for node in self._layers.values()}
        return [outputs[self._names[0]]]

    def rounded(self) -> bytes:
        graph = self._model.graph
        scales = {
            name: np.float32((high - low) / 255.0 or 1.0)
            for name, (low, high) in self._ranges.items()
        }
        nodes: list[Any] = []
        made = {}

        def rounding(name: str, scale: Any, zero: Any, axis: int | None = None) -> str:
            graph.initializer.extend(
                [from_array(scale, f"{name}.scale"), from_array(zero, f"{name}.zero")]
            )
            given = [f"{name}.scale", f"{name}.zero"]
            kind: dict[str, Any] = {} if axis is None else {"axis": axis}
            if zero.dtype == np.int32:  # QuantizeLinear has no such output
                nodes.append(make_node("Div", [name, given[0]], [f"{name}.ratio"]))
                nodes.append(make_node("Round", [f"{name}.ratio"], [f"{name}.whole"]))
                nodes.append(
                    make_node(
                        "Cast", [f"{name}.whole"], [f"{name}.integer"], to=onnx.TensorProto.INT32
                    )
                )
            else:
                nodes.append(
                    make_node("QuantizeLinear", [name, *given], [f"{name}.integer"], **kind)
                )
            nodes.append(
                make_node(
                    "DequantizeLinear", [f"{name}.integer", *given], [f"{name}.rounded"], **kind
                )
            )
            return f"{name}.rounded"

        for node in list(graph.node):
            layer = node.output[0] in self._layers
            if layer:
                weights = self._weights[node.input[1]]
                largest = np.abs(weights).reshape(len(weights), -1).max(axis=1)
                scale = np.where(largest > 0.0, largest / LARGEST_WEIGHT, 1.0).astype(np.float32)
                made[node.input[1]] = rounding(
                    node.input[1], scale, np.zeros(len(scale), np.int8), 0
                )
                bias = scale * scales[node.input[0]]
                made[node.input[2]] = rounding(
                    node.input[2], bias, np.zeros(len(scale), np.int32), 0
                )
            read = [made.get(name, name) for name in node.input]
            del node.input[:]
            node.input.extend(read)
            nodes.append(node)
            for name in node.output:
                if name in scales:
                    zero = np.array(round(-self._ranges[name][0] / scales[name]), np.uint8)
                    made[name] = rounding(name, np.array(scales[name]), zero)
        del graph.node[:]
        graph.node.extend(nodes)
        onnx.checker.check_model(self._model)
        return self._model.SerializeToString()  # type: ignore[no-any-return]
