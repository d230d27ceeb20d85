"""Small ONNX models of boxes, for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

FLOAT = TensorProto.FLOAT


def write(
    path: Path,
    outputs: dict[str, Any],
    shape: list[int | str] | None = None,
    names: str | None = None,
    kind: int = FLOAT,
    metadata: dict[str, str] | None = None,
) -> Path:
    """A model with constant outputs; lists of whole numbers are int64."""
    nodes, declared = [], []
    for name, value in outputs.items():
        array = np.asarray(value)
        array = array.astype(np.int64 if array.ndim <= 2 and name == "labels" else np.float32)
        nodes.append(helper.make_node("Constant", [], [name], value=numpy_helper.from_array(array)))
        declared.append(
            helper.make_tensor_value_info(
                name, helper.np_dtype_to_tensor_dtype(array.dtype), array.shape
            )
        )
    picture = helper.make_tensor_value_info("images", kind, shape or [1, 3, 240, 320])
    return save(path, nodes, [picture], declared, names, metadata)


def save(
    path: Path,
    nodes: list[Any],
    inputs: list[Any],
    outputs: list[Any],
    names: str | None = None,
    metadata: dict[str, str] | None = None,
) -> Path:
    model = helper.make_model(
        helper.make_graph(nodes, "g", inputs, outputs), opset_imports=[helper.make_opsetid("", 18)]
    )
    model.ir_version = 10
    helper.set_model_props(model, (metadata or {}) | ({} if names is None else {"names": names}))
    onnx.save(model, path)
    return path


def red_square_model(path: Path, shape: list[int | str]) -> Path:
    """A YOLO-style model of one class that finds the box of all red pixels."""

    def node(kind: str, inputs: list[str], output: str, **attributes: Any) -> Any:
        return helper.make_node(kind, inputs, [output], **attributes)

    def constant(name: str, value: Any, dtype: Any) -> Any:
        return node("Constant", [], name, value=numpy_helper.from_array(np.asarray(value, dtype)))

    nodes = [
        constant("zero", [0], np.int64),
        constant("one", [1], np.int64),
        constant("two", [2], np.int64),
    ]
    nodes += [
        constant("axis", [1], np.int64),
        constant("half", 0.5, np.float32),
        constant("far", 1e4, np.float32),
    ]
    nodes += [
        constant("first", 0, np.int64),
        constant("unit", 1, np.int64),
        constant("nothing", 0.0, np.float32),
    ]
    nodes += [
        node("Slice", ["images", "zero", "one", "axis"], "r"),
        node("Slice", ["images", "one", "two", "axis"], "g"),
    ]
    nodes += [node("Sub", ["r", "g"], "redness"), node("Shape", ["redness"], "size")]
    for side, (kept, other) in {"x": (3, 2), "y": (2, 3)}.items():
        nodes += [
            constant(f"other_{side}", [0, 1, other], np.int64),
            constant(f"at_{side}", kept, np.int64),
        ]
        nodes += [node("ReduceMax", ["redness", f"other_{side}"], f"line_{side}", keepdims=0)]
        nodes += [node("Greater", [f"line_{side}", "half"], f"mask_{side}")]
        nodes += [node("Gather", ["size", f"at_{side}"], f"count_{side}")]
        nodes += [node("Range", ["first", f"count_{side}", "unit"], f"index_{side}")]
        nodes += [node("Cast", [f"index_{side}"], f"place_{side}", to=FLOAT)]
        nodes += [node("Where", [f"mask_{side}", f"place_{side}", "far"], f"low_places_{side}")]
        nodes += [node("ReduceMin", [f"low_places_{side}"], f"low_{side}", keepdims=0)]
        nodes += [
            node("Where", [f"mask_{side}", f"place_{side}", "nothing"], f"high_places_{side}")
        ]
        nodes += [node("ReduceMax", [f"high_places_{side}"], f"last_{side}", keepdims=0)]
        nodes += [
            constant(f"step_{side}", 1.0, np.float32),
            node("Add", [f"last_{side}", f"step_{side}"], f"high_{side}"),
        ]
        nodes += [node("Add", [f"low_{side}", f"high_{side}"], f"sum_{side}")]
        nodes += [node("Mul", [f"sum_{side}", "half"], f"middle_{side}")]
        nodes += [node("Sub", [f"high_{side}", f"low_{side}"], f"extent_{side}")]
    nodes += [
        node("ReduceMax", ["redness"], "score", keepdims=0),
        constant("as_cell", [1, 1, 1], np.int64),
    ]
    parts = ["middle_x", "middle_y", "extent_x", "extent_y", "score"]
    nodes += [node("Reshape", [name, "as_cell"], f"{name}_cell") for name in parts]
    nodes += [node("Concat", [f"{name}_cell" for name in parts], "output0", axis=1)]
    picture = helper.make_tensor_value_info("images", FLOAT, shape)
    return save(
        path, nodes, [picture], [helper.make_tensor_value_info("output0", FLOAT, [1, 5, 1])]
    )


def colour_model(path: Path, **metadata: str) -> Path:
    """A YOLO-style model of one class whose only box has the mean of the input's red as its score."""
    box = numpy_helper.from_array(np.array([[[160.0], [120.0], [40.0], [40.0]]], np.float32))
    nodes = [helper.make_node("Constant", [], [name], value=value) for name, value in (
        ("box", box),
        ("zero", numpy_helper.from_array(np.array([0]))),
        ("one", numpy_helper.from_array(np.array([1]))),
        ("sides", numpy_helper.from_array(np.array([2, 3]))),
    )]  # fmt: skip
    nodes += [
        helper.make_node("Slice", ["images", "zero", "one", "one"], ["red"]),
        helper.make_node("ReduceMean", ["red", "sides"], ["mean"], keepdims=0),
        helper.make_node("Unsqueeze", ["mean", "zero"], ["score"]),
        helper.make_node("Concat", ["box", "score"], ["output0"], axis=1),
    ]
    picture = helper.make_tensor_value_info("images", FLOAT, [1, 3, 240, 320])
    return save(
        path,
        nodes,
        [picture],
        [helper.make_tensor_value_info("output0", FLOAT, [1, 5, 1])],
        None,
        metadata,
    )
