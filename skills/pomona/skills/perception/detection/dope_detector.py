"""A DOPE user's own detector: their weights and config_pose.yaml, as the instances that the compact detector gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.dope_decode import decode_maps
from pomona.skills.perception.detection.dope_network import DopeNetwork, dope_input
from pomona.skills.perception.detection.errors import BadPoseConfig, PoseUnsolved
from pomona.skills.perception.detection.instances import Instance
from pomona.skills.perception.detection.options import DopeFiles
from pomona.skills.perception.detection.pose import solve_pose
from pomona.skills.perception.detection.pose_config import ObjectEntry, PoseConfig, load_pose_config
from pomona.skills.perception.detection.rigid_pose import cuboid_in_picture
from pomona.skills.perception.detection.weights import load_weights

SAME_SIZE = 0.05
"""A configured cuboid whose sides differ more than this part from the fruit's mesh belongs to something else."""


class DopeDetector:
    """The full network, ready to run on the CPU; a picture takes seconds.

    Args:
        network: in evaluation mode.
        config: thresholds and the height to which pictures are shrunk.
        dimensions: of the cuboid [m].
    """

    def __init__(self, network: DopeNetwork, config: PoseConfig, dimensions: Float64) -> None:
        self._network, self._config, self._dimensions = network, config, dimensions

    @classmethod
    def load(cls, files: DopeFiles, fruit: str, dimensions: tuple[float, float, float]) -> DopeDetector:
        """Load a user's files for a fruit.

        Args:
            files: of the user.
            fruit: its name.
            dimensions: of its mesh [m].

        Raises:
            BadWeights: unreadable, or not the full network's.
            BadPoseConfig: unreadable, without this fruit, or with a cuboid that is not the fruit's.
        """
        config = load_pose_config(files.config)
        entry = _entry(files.config, config, fruit, np.array(dimensions))
        return cls(load_weights(files.weights), config, entry.dimensions)

    def find_instances(self, colour: NDArray[np.uint8], K: Float64) -> list[Instance]:
        """All objects of a picture with their poses, by falling belief.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].

        Raises:
            BadFrame: the picture has another shape or type.
        """
        tensor, factor = dope_input(colour, self._config.downscale_height)
        with torch.inference_mode():
            beliefs, affinities = self._network(tensor)
        found = decode_maps(beliefs[-1][0].numpy(), affinities[-1][0].numpy(), self._config.thresholds)
        instances = []
        for one in sorted(found, key=lambda one: -one.score):
            keypoints = one.keypoints / factor
            try:
                solved = solve_pose(keypoints, self._dimensions, K)
            except PoseUnsolved as error:
                # What was found is drawn; what was not lies at the centroid.
                drawn = np.where(np.isfinite(keypoints), keypoints, keypoints[8])
                instances.append(Instance(drawn, _belief(one.score), _seen(keypoints), None, None, str(error)))
                continue
            drawn = cuboid_in_picture(solved.T_camera_object, self._dimensions, K)
            belief, seen = _belief(one.score), _seen(keypoints)
            instances.append(Instance(drawn, belief, seen, solved.T_camera_object, solved.covariance))
        return instances


def _entry(path: Path, config: PoseConfig, fruit: str, dimensions: Float64) -> ObjectEntry:
    """The fruit's entry: of its name, or the only one."""
    entry = config.objects.get(fruit)
    if entry is None and len(config.objects) == 1:
        entry = next(iter(config.objects.values()))
    if entry is None:
        raise BadPoseConfig(path, f"configures {', '.join(config.objects)}, not {fruit}")
    if np.any(np.abs(entry.dimensions - dimensions) > SAME_SIZE * dimensions):
        cuboid, mesh = (" × ".join(f"{100 * v:.1f}" for v in sides) for sides in (entry.dimensions, dimensions))
        raise BadPoseConfig(
            path, f"{entry.name} is {cuboid} cm, the mesh of {fruit} {mesh} cm: they must be the same object"
        )
    return entry


def _belief(score: float) -> float:
    return float(np.clip(score, 0.0, 1.0))


def _seen(keypoints: Float64) -> float:
    """The part of the corners that were found stands for how much is seen, which DOPE does not say."""
    return float(np.isfinite(keypoints[:8]).all(axis=1).mean())
