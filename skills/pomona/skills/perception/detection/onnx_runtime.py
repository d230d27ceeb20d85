"""Networks in ONNX, run by ONNX Runtime on the CPU."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_graph import BadGraph, judge_layers
from pomona.skills.perception.detection.outputs import Network

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read at import: no upload, no database in the user's cache
import onnxruntime

INPUT = "picture"


def open_session(source: bytes | str) -> Any:
    """Return a session of a model, or of its file, in the caller's thread; errors are reported by exceptions alone."""
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = settings.inter_op_num_threads = 1
    settings.log_severity_level = 4  # errors raise; their copy on the error stream would be a second message
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
        raise BadWeights(path, f"{name} in it cannot be read as ONNX: {type(error).__name__}") from error
    inputs = [given.name for given in network.get_inputs()]
    if inputs != [INPUT]:
        raise BadWeights(path, f"{name} in it has the inputs {inputs}, expected [{INPUT!r}]")

    def run(pictures: Float32) -> list[Float32]:
        return network.run(None, {INPUT: pictures})  # type: ignore[no-any-return]

    return run
