"""Weights files: published DOPE checkpoints and the compact detector's own."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pomona.skills.perception.detection.compact_network import CloseLookNetwork, FinderNetwork
from pomona.skills.perception.detection.dope_network import DopeNetwork
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.outputs import ALL_OUTPUTS, LEAST_OUTPUTS
from pomona.skills.perception.detection.scores import ScoreMap

FORMAT = "pomona compact detector 2"


def load_weights(path: Path | str) -> DopeNetwork:
    """Load a published DOPE checkpoint, with or without the `module.` prefix of data-parallel training.

    Raises:
        BadWeights: unreadable, not a mapping of tensors, or with keys or shapes that do not fit.
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
    about: dict[str, str] | None = None,
    scores: ScoreMap | None = None,
) -> None:
    """Write both networks of the compact detector into one file, in half precision.

    Args:
        path: written atomically.
        finder, close_look: of any widths; these travel along.
        about: text that travels along: how the weights were made.
        scores: from what the networks say to the share of such finds that are fruit.
    """
    content: dict[str, Any] = {"format": FORMAT, "about": dict(about or {}), "widths": {}}
    if scores is not None:
        content["scores"] = [scores.slope, scores.offset]
    for name, network in (("finder", finder), ("close_look", close_look)):
        content["widths"][name] = list(network.widths)
        content[name] = {
            key: value.half() if value.dtype == torch.float32 else value
            for key, value in network.state_dict().items()
            if not key.endswith("num_batches_tracked")
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    torch.save(content, part)
    part.replace(path)


def load_compact(path: Path | str) -> tuple[FinderNetwork, CloseLookNetwork, dict[str, str]]:
    """Load the compact detector: its two networks in evaluation mode, float32, and what its file says about itself.

    Raises:
        BadWeights: unreadable, another format, or tensors that do not fit.
    """
    content = _read(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise BadWeights(path, f"is not a '{FORMAT}' file")
    try:
        knows_boxes = any(str(key).startswith("box_head.") for key in content["finder"])
        finder = FinderNetwork(_widths(content, "finder", 4), knows_boxes)
        close_look = CloseLookNetwork(_widths(content, "close_look", 5), _outputs(content))
    except (KeyError, TypeError, ValueError) as error:
        raise BadWeights(path, f"does not say how wide its networks are: {error!r}") from error
    for name, network in (("finder", finder), ("close_look", close_look)):
        counters = {key: value for key, value in network.state_dict().items() if key.endswith("num_batches_tracked")}
        tensors = {key: value.float() for key, value in _tensors(path, content.get(name)).items()}
        fill(network, {**counters, **tensors}, path)
    return finder.eval(), close_look.eval(), {str(k): str(v) for k, v in content.get("about", {}).items()}


def load_scores(path: Path | str) -> ScoreMap:
    """What the scores of a weights file mean; weights that were never calibrated keep theirs.

    Raises:
        BadWeights: unreadable, or a map that is none.
    """
    content = _read(path)
    try:
        slope, offset = (float(value) for value in content.get("scores", (1.0, 0.0)))
    except (AttributeError, TypeError, ValueError) as error:
        raise BadWeights(path, f"does not say what its scores mean: {error}") from error
    if not (math.isfinite(offset) and 0.0 < slope < math.inf):
        raise BadWeights(path, f"maps its scores by the line {slope} x + {offset}, which does not rise")
    return ScoreMap(slope, offset)


def fill(network: nn.Module, tensors: dict[str, Tensor], path: Path | str) -> None:
    """Put tensors into a network; every key and shape must fit.

    Raises:
        BadWeights: naming what is missing, not expected or of another shape.
    """
    wanted = network.state_dict()
    missing, unknown = sorted(wanted.keys() - tensors.keys()), sorted(tensors.keys() - wanted.keys())
    if missing or unknown:
        raise BadWeights(
            path,
            f"keys do not match {type(network).__name__}: {len(missing)} missing ({_some(missing)}), "
            f"{len(unknown)} not expected ({_some(unknown)})",
        )
    for key, value in wanted.items():
        if tensors[key].shape != value.shape:
            raise BadWeights(path, f"{key} has shape {tuple(tensors[key].shape)}, expected {tuple(value.shape)}")
        if not torch.isfinite(tensors[key].float()).all():
            raise BadWeights(path, f"{key} holds values that are not finite")
    network.load_state_dict(tensors)


def _widths(content: dict[str, Any], name: str, count: int) -> Any:
    widths = tuple(int(width) for width in content["widths"][name])
    if len(widths) != count or not all(1 <= width <= 1024 for width in widths):
        raise ValueError(f"expected {count} widths, not {widths}")
    return widths


def _outputs(content: dict[str, Any]) -> int:
    """How much the close look says: weights made before it knew boxes have fewer outputs."""
    count = int(content["close_look"]["head.3.bias"].shape[0])
    return count if count in (LEAST_OUTPUTS, ALL_OUTPUTS) else ALL_OUTPUTS


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
