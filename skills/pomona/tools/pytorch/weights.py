"""Weights in PyTorch: published DOPE checkpoints, and the compact detector's networks to and from its weights file."""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from pomona.skills.perception.detection.close_look import CLOSE_LOOK_OUTPUTS, CLOSE_LOOK_SIZE
from pomona.skills.perception.detection.errors import BadWeights, MissingPackage
from pomona.skills.perception.detection.onnx_runtime import INPUT
from pomona.skills.perception.detection.weights_file import (
    PowerScore,
    Score,
    StoredDetector,
    is_torch_file,
    read_weights,
    score_map,
    write_weights,
)
from pomona.tools.pytorch.networks import BeliefFinder, CloseLookNetwork, DopeNetwork, FinderNetwork

TORCH_FORMAT = (
    "pomona compact detector 2"  # format of the files that earlier versions wrote with PyTorch
)

OPSET = 18

FINDER_EXAMPLE = (1, 3, 192, 256)
CLOSE_LOOK_EXAMPLE = (2, 3, CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
"""Shapes of inputs with which the networks are traced; a graph keeps none of these sizes but that of the looks."""

Finder = FinderNetwork | BeliefFinder

LAST_LAYER = "head.3.weight", "head.3.bias"  # parameters of the close look's last layer
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
    finder: Finder,
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
    write_weights(path, _store(path, finder, close_look, about or {}, scores or PowerScore()))


def load_compact(path: Path | str) -> tuple[Finder, CloseLookNetwork, dict[str, str]]:
    """Load the compact detector: both networks in evaluation mode, float32, and the text about them.

    Raises:
        BadWeights: unreadable, another format, or tensors that do not fit.
        MissingPackage: without the package onnx.
    """
    if is_torch_file(path):
        finder, close_look, about, _ = _load_torch(path)
        return finder, close_look, about
    stored = read_weights(path)
    tensors = {
        "finder": _initialisers(path, stored.finder),
        "close_look": _initialisers(path, stored.close_look),
    }
    finder, close_look = _built(path, {"widths": stored.widths, **tensors})
    return finder, close_look, dict(stored.about)


def convert(path: Path | str) -> StoredDetector:
    """Read a file that an earlier version wrote with PyTorch, as the content of a weights file.

    Raises:
        BadWeights: unreadable, another format, or tensors that do not fit.
        MissingPackage: without the package onnx.
    """
    return _store(path, *_load_torch(path))


def try_compact(path: str) -> None:
    """Read a file that an earlier version wrote; runs in a process of its own. Raises BadWeights."""
    _load_torch(path)


def try_dope(path: str) -> None:
    """Read a checkpoint; runs in a process of its own. Raises BadWeights."""
    load_weights(path)


def fill(network: nn.Module, tensors: dict[str, Tensor], path: Path | str) -> None:
    """Put tensors into a network; every key and shape must fit.

    Raises BadWeights: naming the keys that are missing or not expected, or a wrong shape.
    """
    wanted = network.state_dict()
    missing, unknown = (
        sorted(wanted.keys() - tensors.keys()),
        sorted(tensors.keys() - wanted.keys()),
    )
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


def _store(
    path: Path | str,
    finder: Finder,
    close_look: CloseLookNetwork,
    about: Mapping[str, str],
    scores: Score,
) -> StoredDetector:
    widths = {"close_look": list(close_look.widths)}
    if isinstance(finder, BeliefFinder):
        widths["finder"] = list(finder.widths)
    return StoredDetector(
        exported(
            path,
            finder,
            FINDER_EXAMPLE,
            ["maps"],
            {name: {0: "n", 2: "h", 3: "w"} for name in (INPUT, "maps")},
        ),
        exported(
            path, close_look, CLOSE_LOOK_EXAMPLE, ["look"], {INPUT: {0: "n"}, "look": {0: "n"}}
        ),
        about,
        scores,
        widths,
    )


def exported(
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
    content, training = io.BytesIO(), network.training
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
    picture, casts = graph.input[0], []
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
    """Return the parameters of a network that `exported` wrote."""
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


def _load_torch(path: Path | str) -> tuple[Finder, CloseLookNetwork, dict[str, str], Score]:
    content = _read(path)
    if not isinstance(content, dict) or content.get("format") != TORCH_FORMAT:
        raise BadWeights(path, f"is not a '{TORCH_FORMAT}' file")
    finder, close_look = _built(path, content)
    about = {str(key): str(value) for key, value in content.get("about", {}).items()}
    return finder, close_look, about, PowerScore(score_map(path, content.get("scores", (1.0, 0.0))))


def _built(path: Path | str, content: Mapping[str, Any]) -> tuple[Finder, CloseLookNetwork]:
    """Return both networks in evaluation mode from their widths and tensors."""
    try:
        finder: Finder = FinderNetwork()
        if "finder" in content["widths"]:
            knows_boxes = any(str(key).startswith("box_head.") for key in content["finder"])
            finder = BeliefFinder(_widths(content, "finder", 4), knows_boxes)
        close_look = CloseLookNetwork(_widths(content, "close_look", 5))
    except (KeyError, TypeError, ValueError) as error:
        raise BadWeights(path, f"has no usable widths of its networks: {error!r}") from error
    for name, network in (("finder", finder), ("close_look", close_look)):
        counters = {
            key: value
            for key, value in network.state_dict().items()
            if key.endswith("num_batches_tracked")
        }
        tensors = _tensors(path, content.get(name))
        if name == "close_look":  # some earlier ones had four outputs more, of a box
            tensors |= {
                key: tensors[key][:CLOSE_LOOK_OUTPUTS] for key in LAST_LAYER if key in tensors
            }
        fill(network, {**counters, **tensors}, path)  # copies into float32
    return finder.eval(), close_look.eval()


def _widths(content: Mapping[str, Any], name: str, count: int) -> Any:
    widths = tuple(int(width) for width in content["widths"][name])
    if len(widths) != count or not all(1 <= width <= 1024 for width in widths):
        raise ValueError(f"expected {count} widths, not {widths}")
    return widths


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
