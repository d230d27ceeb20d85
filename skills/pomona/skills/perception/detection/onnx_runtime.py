"""Networks as ONNX files: judged before they are opened, and run by onnxruntime.

ONNX's own package is not needed for it: a file is a protocol buffer, of which only the nodes are read here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.detection.close_look import Network
from pomona.skills.perception.detection.errors import BadWeights

os.environ.setdefault(
    "ORT_DISABLE_TELEMETRY", "1"
)  # read at import: no upload, no database in the user's cache
import onnxruntime

INPUT = "picture"


def open_session(source: bytes | str) -> Any:
    """Return a session of a model, or of its file, in the caller's thread; errors are reported by exceptions alone."""
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    # errors raise; their copy on the error stream would be a second message
    settings.log_severity_level = 4
    return onnxruntime.InferenceSession(source, settings, providers=["CPUExecutionProvider"])


def judge_network(content: bytes, path: Path | str, name: str) -> None:
    """Raise BadWeights if a network of layers, a member of a weights file, is not one that is loaded."""
    try:
        judge_layers(content, INPUT)
    except BadGraph as error:
        raise BadWeights(path, f"{name} in it {error}") from error


def onnx_network(content: bytes, path: Path | str, name: str) -> Network:
    """Return a network that runs in the caller's thread, without the interpreter's lock.

    On layers this small, two threads wait for each other longer than they work, and disturb a control loop.

    Args:
        content: the network as ONNX.
        path, name: weights file and its member, for the error.

    Raises BadWeights: ONNX Runtime cannot read the content, or it takes anything but a picture.
    """
    try:
        network = open_session(content)
    except Exception as error:  # ONNX Runtime's errors have no common root
        raise BadWeights(
            path, f"{name} in it cannot be read as ONNX: {type(error).__name__}"
        ) from error
    inputs = [given.name for given in network.get_inputs()]
    if inputs != [INPUT]:
        raise BadWeights(path, f"{name} in it has the inputs {inputs}, expected [{INPUT!r}]")

    def run(pictures: Float32) -> list[Float32]:
        return network.run(None, {INPUT: pictures})  # type: ignore[no-any-return]

    return run


MOST_NODES = 20_000  # the largest shipped network has 1990
MOST_NESTED = 4  # graphs inside of nodes, one in the other

LOOPS = frozenset({"Loop", "Scan", "SequenceMap"})

PLAIN = frozenset(
    (
        "Abs",
        "Add",
        "AveragePool",
        "BatchNormalization",
        "Cast",
        "Ceil",
        "Clip",
        "Concat",
        "Constant",
        "ConstantOfShape",
        "Conv",
        "ConvTranspose",
        "DequantizeLinear",
        "Div",
        "Elu",
        "Exp",
        "Expand",
        "Flatten",
        "Floor",
        "Gather",
        "Gemm",
        "GlobalAveragePool",
        "GlobalMaxPool",
        "HardSigmoid",
        "HardSwish",
        "Identity",
        "LayerNormalization",
        "LeakyRelu",
        "Log",
        "MatMul",
        "Max",
        "MaxPool",
        "Min",
        "Mul",
        "Neg",
        "Pad",
        "Pow",
        "PRelu",
        "QuantizeLinear",
        "Range",
        "ReduceMax",
        "ReduceMean",
        "ReduceMin",
        "ReduceSum",
        "Relu",
        "Reshape",
        "Resize",
        "Round",
        "Shape",
        "Sigmoid",
        "Slice",
        "Softmax",
        "Softplus",
        "Split",
        "Sqrt",
        "Squeeze",
        "Sub",
        "Tanh",
        "Tile",
        "Transpose",
        "Unsqueeze",
        "Where",
    )
)
"""Operators of a network of layers. The size of each result follows from the sizes of its inputs, but for `SIZED`."""
SIZED = {
    "Resize": (1, 2, 3),
    "Reshape": (1,),
    "Expand": (1,),
    "Tile": (1,),
    "Pad": (1, 3),
    "ConstantOfShape": (0,),
    "Range": (0, 1, 2),
}
"""Operators whose result is as large as the values of these inputs state; none of them may follow from the picture."""

# fields of a model
_GRAPH = 7
_FUNCTIONS = 25
_NODE = 1  # field of a graph
# fields of a node
_INPUT = 1
_OUTPUT = 2
_OPERATOR = 4
_ATTRIBUTE = 5
_DOMAIN = 7
# fields of an attribute
_ONE_GRAPH = 6
_GRAPHS = 11
_OWN_DOMAINS = ("", "ai.onnx")


class BadGraph(ValueError):
    """A graph that is not loaded: why, as the rest of a sentence."""


@dataclass(slots=True)
class _Node:
    operator: str = ""
    domain: str = ""
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    graphs: list[memoryview] = field(default_factory=list)


def judge_layers(content: bytes, picture: str) -> None:
    """Judge a network of layers, whose only input is `picture`.

    Raises BadGraph: it has another operator than `PLAIN`, a size that follows from the picture, or is damaged.
    """
    from_picture = {picture}
    used = set[str]()
    for node in _nodes(content):
        used.update(node.inputs)
        if not used.isdisjoint(node.outputs):
            raise BadGraph("lists a node before one whose result it takes: export it anew")
        if node.domain not in _OWN_DOMAINS or node.operator not in PLAIN or node.graphs:
            name = ".".join(filter(None, (node.domain, node.operator)))
            raise BadGraph(
                f"has the operator '{name[:60]}', which a network of layers does not have: export it anew"
            )
        sizes = [node.inputs[k] for k in SIZED.get(node.operator, ()) if k < len(node.inputs)]
        if from_picture.intersection(sizes):
            raise BadGraph(
                f"computes a size of its operator '{node.operator}' from the picture: export it anew"
            )
        if node.operator != "Shape" and from_picture.intersection(node.inputs):
            from_picture.update(node.outputs)


def judge_model(content: bytes | memoryview) -> None:
    """Judge a network of any origin. Raises BadGraph: it has loops, functions, too many nodes, or is damaged."""
    for node in _nodes(content):
        if node.operator in LOOPS:
            raise BadGraph(
                f"has the operator '{node.operator}': a detector has no loops, export it without"
            )


def _nodes(content: bytes | memoryview) -> Iterator[_Node]:
    """Yield all nodes, also those of graphs in nodes."""
    waiting: list[tuple[memoryview, int]] = []
    for number, value in _fields(memoryview(content)):
        if number == _FUNCTIONS:
            raise BadGraph("defines functions of its own: export it without")
        if number == _GRAPH and isinstance(value, memoryview):
            waiting.append((value, 0))
    count = 0
    while waiting:
        graph, depth = waiting.pop()
        for number, value in _fields(graph):
            if number != _NODE or not isinstance(value, memoryview):
                continue
            count += 1
            if count > MOST_NODES:
                raise BadGraph(
                    f"has more than {MOST_NODES} nodes, which are the most that are read"
                )
            node = _node(value)
            if node.graphs and depth == MOST_NESTED:
                raise BadGraph(f"has graphs in its nodes, more than {MOST_NESTED} deep")
            waiting += [(inner, depth + 1) for inner in node.graphs]
            yield node


def _node(content: memoryview) -> _Node:
    node = _Node()
    for number, value in _fields(content):
        if not isinstance(value, memoryview):
            continue
        if number == _INPUT:
            node.inputs.append(_text(value))
        elif number == _OUTPUT:
            node.outputs.append(_text(value))
        elif number == _OPERATOR:
            node.operator = _text(value)
        elif number == _DOMAIN:
            node.domain = _text(value)
        elif number == _ATTRIBUTE:
            graphs = [part for inner, part in _fields(value) if inner in (_ONE_GRAPH, _GRAPHS)]
            node.graphs += [part for part in graphs if isinstance(part, memoryview)]
    return node


def _text(content: memoryview) -> str:
    return bytes(content).decode("utf-8", "replace")


def _fields(content: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield number and value of each field of a message. Raises BadGraph: it is damaged."""
    at = 0
    end = len(content)
    while at < end:
        key, at = _varint(content, at)
        number = key >> 3
        kind = key & 7
        if kind == 0:
            value, at = _varint(content, at)
            yield number, value
            continue
        if kind == 2:
            length, at = _varint(content, at)
        else:
            length = {1: 8, 5: 4}.get(kind, -1)
        if length < 0 or at + length > end:
            raise BadGraph("cannot be read as ONNX: it is damaged")
        if kind == 2:
            yield number, content[at : at + length]
        at += length


def _varint(content: memoryview, at: int) -> tuple[int, int]:
    value = 0
    shift = 0
    while at < len(content) and shift < 70:
        byte = content[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
    raise BadGraph("cannot be read as ONNX: it is damaged")
