"""Detect: fruit in a picture, as nine keypoints and a pose.

`from pomona.skills.perception.detection import DopeNetwork, load_weights, decode_maps, solve_pose` loads what is asked
for and no more: the networks bring torch along, which other skills that only know a `Detection` need not wait for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pomona.skills.perception.detection.cuboid import CuboidConvention
    from pomona.skills.perception.detection.dope_decode import DecodedObject, DecodeThresholds, decode_maps
    from pomona.skills.perception.detection.dope_network import DopeNetwork
    from pomona.skills.perception.detection.pose import SolvedPose, solve_pose
    from pomona.skills.perception.detection.pose_config import load_pose_config
    from pomona.skills.perception.detection.weights import load_weights

__all__ = [
    "CuboidConvention",
    "DecodeThresholds",
    "DecodedObject",
    "DopeNetwork",
    "SolvedPose",
    "decode_maps",
    "load_pose_config",
    "load_weights",
    "solve_pose",
]

_MODULES = {
    "CuboidConvention": "cuboid",
    "DecodeThresholds": "dope_decode",
    "DecodedObject": "dope_decode",
    "DopeNetwork": "dope_network",
    "SolvedPose": "pose",
    "decode_maps": "dope_decode",
    "load_pose_config": "pose_config",
    "load_weights": "weights",
    "solve_pose": "pose",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
