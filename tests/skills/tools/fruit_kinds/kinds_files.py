"""Files of kinds whose network tells colours apart, for tests."""

from __future__ import annotations

import json
from pathlib import Path
from zipfile import ZipFile

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from pomona.skills.perception.detection.onnx_runtime import INPUT
from pomona.tools.fruit_kinds.kind_head import ABOUT, FORMAT, NETWORK, NONE

STEEP = 20.0  # logit of a kind for one unit of its colour


def colour_network(rows: int = 3) -> bytes:
    """Logits of red, green and blue in the middle of a picture, of which this number is given."""
    weight = numpy_helper.from_array(
        (STEEP * np.eye(3)[:rows]).reshape(rows, 3, 1, 1).astype(np.float32), "weight"
    )
    sides = numpy_helper.from_array(np.array([2, 3]), "sides")
    nodes = [
        helper.make_node("ReduceMean", [INPUT, "sides"], ["mean"], keepdims=1),
        helper.make_node("Conv", ["mean", "weight"], ["colours"]),
        helper.make_node("Squeeze", ["colours", "sides"], ["kinds"]),
    ]
    picture = helper.make_tensor_value_info(INPUT, TensorProto.FLOAT, ["n", 3, 96, 96])
    kinds = helper.make_tensor_value_info("kinds", TensorProto.FLOAT, ["n", rows])
    graph = helper.make_graph(nodes, "g", [picture], [kinds], [weight, sides])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])
    model.ir_version = 10
    return bytes(model.SerializeToString())


def colour_kinds(
    path: Path, kinds: tuple[str, ...] = ("apple", "lime", NONE), rows: int = 3
) -> Path:
    """A file whose first kind is red, whose second is green, and whose third is blue."""
    about = {
        "format": FORMAT,
        "kinds": kinds,
        "score": {"found": 1.0, "kind": 1.0, "offset": 0.0},
        "about": {"made": "for tests"},
    }
    with ZipFile(path, "w") as archive:
        archive.writestr(NETWORK, colour_network(rows))
        archive.writestr(ABOUT, json.dumps(about))
    return path
