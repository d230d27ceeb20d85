"""Weights in PyTorch: published DOPE checkpoints, and the compact detector's networks to and from its weights file."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pomona.skills.perception.detection.close_look import CLOSE_LOOK_SIZE
from pomona.skills.perception.detection.errors import BadWeights, MissingPackage
from pomona.skills.perception.detection.onnx_runtime import INPUT
from pomona.skills.perception.detection.weights_file import (
    PowerScore,
    Score,
    StoredDetector,
    read_weights,
    write_weights,
)
from pomona.tools.pytorch.networks import CloseLookNetwork, DopeNetwork, FinderNetwork

OPSET = 18

FINDER_EXAMPLE = (1, 3, 192, 256)
CLOSE_LOOK_EXAMPLE = (2, 3, CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
"""Shapes of inputs with which the networks are traced; a graph keeps none of these sizes but that of the looks."""

_HALF = ".half"  # ending of an initialiser in half precision; the graph casts it to the parameter of the name before


def load_weights(path: Path | str) -> DopeNetwork:
    """Load a published DOPE checkpoint, with or without the `module.` prefix of data-parallel training.

    Raises BadWeights: unreadable, not a mapping of tensors, or with keys or shapes that do not fit.
    """
    tensors = _tensors(path, _read(path))
    stripped = {key.removeprefix("module."): value for key, value in tensors.items()}
    network = DopeNetwork()
    fill(network, stripped, path)
    return network.eval()


def save_compact(
    path: Path,
    finder: FinderNetwork,
    close_look: CloseLookNetwork,
    about: Mapping[str, str] | None = None,
    scores: Score | None = None,
) -> None:
    """Write both networks of the compact detector into a weights file, in half precision.

    Args:
        path: written atomically.
        finder, close_look: of any widths; these travel along.
        about: text that travels along: how the weights were made.
        scores: from the answers of both networks to the ratio of such detections that are fruit.

    Raises BadWeights: a parameter is not finite, or exceeds half precision; MissingPackage: without the package onnx.
    """
    free = {name: {0: "n", 2: "h", 3: "w"} for name in (INPUT, "maps")}
    looks = {INPUT: {0: "n"}, "look": {0: "n"}}
    stored = StoredDetector(
        _exported(path, finder, FINDER_EXAMPLE, ["maps"], free),
        _exported(path, close_look, CLOSE_LOOK_EXAMPLE, ["look"], looks),
        about or {},
        scores or PowerScore(),
        {"close_look": list(close_look.widths)},
    )
    write_weights(path, stored)


def can_learn(stored: StoredDetector) -> bool:
    """Return True if training can go on from weights; the finder of the oldest ones is another network."""
    return "finder" not in stored.widths


def load_compact(path: Path | str) -> tuple[FinderNetwork, CloseLookNetwork]:
    """Load the compact detector to train it further: both networks in float32.

    Raises:
        BadWeights: unreadable, another format, tensors that do not fit, or a finder that cannot be trained further.
        MissingPackage: without the package onnx.
    """
    stored = read_weights(path)
    if not can_learn(stored):
        words = "has a finder that cannot be learnt on; that of apple_photographs.weights can"
        raise BadWeights(path, words)
    try:
        finder = FinderNetwork()
        close_look = CloseLookNetwork(_widths(stored.widths["close_look"]))
    except (KeyError, TypeError, ValueError) as error:
        raise BadWeights(path, f"has no usable widths of its networks: {error!r}") from error
    networks: tuple[tuple[nn.Module, bytes], ...]
    networks = (finder, stored.finder), (close_look, stored.close_look)
    for network, content in networks:
        counters = {
            key: value
            for key, value in network.state_dict().items()
            if key.endswith("num_batches_tracked")
        }
        fill(network, {**counters, **_initialisers(path, content)}, path)
    return finder.eval(), close_look.eval()


def _widths(values: Sequence[int]) -> tuple[int, int, int, int, int]:
    a, b, c, d, e = (int(width) for width in values)
    if not 1 <= min(a, b, c, d, e) <= max(a, b, c, d, e) <= 1024:
        raise ValueError(f"widths {values}")
    return a, b, c, d, e


def try_dope(path: str) -> None:
    """Read a checkpoint; runs in a process of its own. Raises BadWeights."""
    load_weights(path)


def fill(network: nn.Module, tensors: dict[str, Tensor], path: Path | str) -> None:
    """Put tensors into a network; every key and shape must fit.

    Raises BadWeights: naming the keys that are missing or not expected, or a wrong shape.
    """
    wanted = network.state_dict()
    missing = sorted(wanted.keys() - tensors.keys())
    unknown = sorted(tensors.keys() - wanted.keys())
    if missing or unknown:
        raise BadWeights(
            path,
            f"keys do not match {type(network).__name__}: {len(missing)} missing ({_some(missing)}), "
            f"{len(unknown)} not expected ({_some(unknown)})",
        )
    for key, value in wanted.items():
        if tensors[key].shape != value.shape:
            raise BadWeights(
                path, f"{key} has shape {tuple(tensors[key].shape)}, expected {tuple(value.shape)}"
            )
        if not torch.isfinite(tensors[key].float()).all():
            raise BadWeights(path, f"{key} holds values that are not finite")
    network.load_state_dict(tensors)


def _exported(
    path: Path | str,
    network: nn.Module,
    example: tuple[int, ...],
    outputs: list[str],
    free: dict[str, dict[int, str]],
) -> bytes:
    """Return a network as ONNX. Initialisers keep the parameters' names, in half precision, so that training can go on.

    ONNX Runtime folds the casts and normalisations when it loads the graph. Raises BadWeights: a value is not finite.
    """
    onnx = _onnx()
    content = io.BytesIO()
    training = network.training
    with warnings.catch_warnings():
        # The exporter by tracing is deprecated; its successor needs one package more and gives the same graph.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network.eval(),
            (torch.zeros(example),),
            content,  # type: ignore[arg-type]  # the exporter by tracing writes into streams, too
            input_names=[INPUT],
            output_names=outputs,
            dynamic_axes=free,
            opset_version=OPSET,
            export_params=False,
            training=torch.onnx.TrainingMode.PRESERVE,
            do_constant_folding=False,
            dynamo=False,
        )
    network.train(training)
    model = onnx.load_model_from_string(content.getvalue())
    graph = model.graph
    parameters = {
        key: value
        for key, value in network.state_dict().items()
        if not key.endswith("num_batches_tracked")
    }
    # A parameter that equals another one is exported as its copy, by a node of its name.
    nodes = [node for node in graph.node if node.output[0] not in parameters]
    picture = graph.input[0]
    casts = []
    for name, value in parameters.items():
        half = value.detach().half().numpy()
        if not np.isfinite(half).all():
            raise BadWeights(path, f"{name} holds values that are not finite in half precision")
        graph.initializer.append(onnx.numpy_helper.from_array(half, name + _HALF))
        casts.append(
            onnx.helper.make_node("Cast", [name + _HALF], [name], to=onnx.TensorProto.FLOAT)
        )
    del graph.input[:], graph.node[:]
    graph.input.append(picture)
    graph.node.extend([*casts, *nodes])
    onnx.checker.check_model(model)
    return model.SerializeToString()  # type: ignore[no-any-return]


def _initialisers(path: Path | str, content: bytes) -> dict[str, Tensor]:
    """Return the parameters of a network that `_exported` wrote."""
    onnx = _onnx()
    try:
        tensors = onnx.load_model_from_string(content).graph.initializer
    except Exception as error:  # protobuf's errors are not onnx's
        raise BadWeights(
            path, f"holds a network that is not ONNX: {type(error).__name__}"
        ) from error
    named = {
        tensor.name: onnx.numpy_helper.to_array(tensor)
        for tensor in tensors
        if tensor.name.endswith(_HALF)
    }
    return {
        name.removesuffix(_HALF): torch.from_numpy(values.copy()) for name, values in named.items()
    }


def _onnx() -> Any:
    try:
        import onnx
    except ImportError as error:
        raise MissingPackage("onnx", "writes and reads networks for training") from error
    return onnx


def _read(path: Path | str) -> Any:
    if not Path(path).is_file():
        raise BadWeights(path, "no such file")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch.load raises whatever unpickling meets
        raise BadWeights(path, f"cannot be read as weights: {type(error).__name__}") from error


def _tensors(path: Path | str, content: Any) -> dict[str, Tensor]:
    if not isinstance(content, dict) or not all(isinstance(v, Tensor) for v in content.values()):
        raise BadWeights(path, "expected a mapping from names to tensors")
    return {str(key): value for key, value in content.items()}


def _some(keys: list[str]) -> str:
    return ", ".join(keys[:3]) + (", …" if len(keys) > 3 else "") if keys else "none"
