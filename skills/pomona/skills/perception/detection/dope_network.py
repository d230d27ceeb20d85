"""The full DOPE network, with the tensors and key names of the published checkpoints."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pomona.skills.perception.detection.frame_check import check_picture

STRIDE = 8  # input pixels per cell of the maps

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)

BELIEF_MAPS, AFFINITY_MAPS, STAGES = 9, 16, 6
_VGG_WIDTHS = (64, 64, 0, 128, 128, 0, 256, 256, 256, 256, 0, 512, 512)  # 0: halving


class DopeNetwork(nn.Module):
    """Six stages of belief (9) and affinity (16) maps on VGG-19 features; 50 267 350 parameters.

    Input: RGB minus ImageNet's mean over its deviation, (n, 3, h, w). Output: two lists with one tensor a stage,
    belief (n, 9, h/8, w/8) and affinity (n, 16, h/8, w/8).
    """

    def __init__(self) -> None:
        super().__init__()
        self.vgg = _features()
        self.m1_2, self.m1_1 = _first_stage(BELIEF_MAPS), _first_stage(AFFINITY_MAPS)
        inputs = 128 + BELIEF_MAPS + AFFINITY_MAPS
        for stage in range(2, STAGES + 1):
            self.add_module(f"m{stage}_2", _later_stage(inputs, BELIEF_MAPS))
            self.add_module(f"m{stage}_1", _later_stage(inputs, AFFINITY_MAPS))

    def forward(self, x: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Belief and affinity maps after each stage, shapes (n, 9, h / 8, w / 8) and (n, 16, h / 8, w / 8)."""
        features = self.vgg(x)
        beliefs, affinities = [self.m1_2(features)], [self.m1_1(features)]
        for stage in range(2, STAGES + 1):
            joined = torch.cat([beliefs[-1], affinities[-1], features], 1)
            beliefs.append(self.get_submodule(f"m{stage}_2")(joined))
            affinities.append(self.get_submodule(f"m{stage}_1")(joined))
        return beliefs, affinities


def dope_input(colour: NDArray[np.uint8], downscale_height: int = 400) -> tuple[Tensor, float]:
    """Return a picture as the network wants it, and the factor by which it was shrunk.

    Args:
        colour: (h, w, 3) uint8 RGB.
        downscale_height: higher pictures are shrunk to this height; scale the camera matrix by the same factor.

    Raises BadFrame: another shape or type.
    """
    check_picture(colour)
    height, width = colour.shape[:2]
    factor = min(1.0, downscale_height / height)
    if factor < 1.0:
        colour = np.asarray(cv2.resize(colour, (int(width * factor), int(height * factor))), np.uint8)
    scaled = torch.from_numpy(np.ascontiguousarray(colour)).permute(2, 0, 1).to(torch.float32) / 255.0
    mean, std = torch.tensor(IMAGENET_MEAN).view(3, 1, 1), torch.tensor(IMAGENET_STD).view(3, 1, 1)
    return ((scaled - mean) / std)[None], factor


def _features() -> nn.Sequential:
    layers = nn.Sequential()
    channels, index = 3, 0
    for width in _VGG_WIDTHS:
        if width == 0:
            layers.add_module(str(index), nn.MaxPool2d(2, 2))
            index += 1
            continue
        layers.add_module(str(index), nn.Conv2d(channels, width, 3, padding=1))
        layers.add_module(str(index + 1), nn.ReLU(inplace=True))
        channels, index = width, index + 2
    for width in (256, 128):
        layers.add_module(str(index), nn.Conv2d(channels, width, 3, padding=1))
        layers.add_module(str(index + 1), nn.ReLU(inplace=True))
        channels, index = width, index + 2
    return layers


def _stage(widths: list[tuple[int, int, int]]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs, outputs, kernel in widths:
        layers += [nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers[:-1])


def _first_stage(outputs: int) -> nn.Sequential:
    return _stage([(128, 128, 3)] * 3 + [(128, 512, 1), (512, outputs, 1)])


def _later_stage(inputs: int, outputs: int) -> nn.Sequential:
    return _stage([(inputs, 128, 7)] + [(128, 128, 7)] * 4 + [(128, 128, 1), (128, outputs, 1)])
