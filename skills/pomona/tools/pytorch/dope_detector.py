"""A DOPE user's own detector: their weights and config_pose.yaml, as the instances that the compact detector gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.executive.values.trial import MEMORY, trial
from pomona.skills.perception.detection.detection import DopeFiles
from pomona.skills.perception.detection.dope_config import PoseConfig, find_entry
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.instances import Instance, cuboid_in_picture
from pomona.tools.pytorch.dope_decode import decode_maps
from pomona.tools.pytorch.networks import DopeNetwork, dope_input
from pomona.tools.pytorch.pose import PoseUnsolved, solve_pose
from pomona.tools.pytorch.weights import load_weights

MOST_BYTES = 256 << 20  # of a checkpoint; DOPE's have 201 MB [byte]


class DopeDetector:
    """The full network, ready to run on the CPU; a picture takes seconds.

    Args:
        network: in evaluation mode.
        config: thresholds and the height to which pictures are shrunk.
        dimensions: of the cuboid [m].
    """

    def __init__(self, network: DopeNetwork, config: PoseConfig, dimensions: Float64) -> None:
        self._network = network
        self._config = config
        self._dimensions = dimensions

    @classmethod
    def load(
        cls,
        files: DopeFiles,
        fruit: str,
        _weights: Path | None,
        dimensions: tuple[float, float, float],
    ) -> DopeDetector:
        """Load a user's files for a fruit.

        Args:
            _weights: of the compact detector; not used.
            dimensions: of its mesh [m].

        Raises:
            BadWeights: unreadable, or not the full network's.
            BadPoseConfig: unreadable, without this fruit, or with a cuboid that is not the fruit's.
        """
        if files.weights.is_file():
            _try(files.weights)
        config, entry = find_entry(files.config, fruit, np.array(dimensions))
        return cls(load_weights(files.weights), config, entry.dimensions)

    def find_instances(
        self, colour: NDArray[np.uint8], K: Float64, depth: Float32 | None = None
    ) -> list[Instance]:
        """Find all objects of a picture with their poses, by falling belief.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].
            depth: not used.

        Raises BadFrame: the picture has another shape or type.
        """
        tensor, factor = dope_input(colour, self._config.downscale_height)
        with torch.inference_mode():
            beliefs, affinities = self._network(tensor)
        found = decode_maps(
            beliefs[-1][0].numpy(), affinities[-1][0].numpy(), self._config.thresholds
        )
        instances = []
        for one in sorted(found, key=lambda one: -one.score):
            keypoints = one.keypoints / factor
            score = float(np.clip(one.score, 0.0, 1.0))
            # DOPE estimates no visibility: the ratio of corners with a peak stands for it.
            seen = float(np.isfinite(keypoints[:8]).all(axis=1).mean())
            try:
                solved = solve_pose(keypoints, self._dimensions, K)
            except PoseUnsolved as error:
                # Keypoints without a peak are drawn at the centroid.
                drawn = np.where(np.isfinite(keypoints), keypoints, keypoints[8])
                instances.append(Instance(drawn, score, seen, None, None, str(error)))
                continue
            T = solved.T_camera_object
            drawn = cuboid_in_picture(T, self._dimensions, K)
            instances.append(Instance(drawn, score, seen, T, solved.covariance))
        return instances


def _try(weights: Path) -> None:
    """Raise BadWeights for a checkpoint that is too large, or that cannot be read in a process of its own."""
    size = weights.stat().st_size
    if size > MOST_BYTES:
        words = (
            f"has {size / 1e6:.0f} MB; a checkpoint of DOPE has at most {MOST_BYTES / 1e6:.0f} MB"
        )
        raise BadWeights(weights, words)
    problem = trial(
        "pomona.tools.pytorch.weights:try_dope", str(weights), memory=MEMORY + size, processor_s=30
    )
    if problem:
        raise BadWeights(weights, problem)
