"""The networks in PyTorch: the finder, the second look, and DOPE's full network.

EfficientNet-Lite0 (Tan and others, 2020; stages 1 to 6 of it) as trunk, a pyramid of features above it (Lin and
others, 2017), and heads as in CenterNet (Zhou and others, 2019): a heat map with one peak per fruit, the reaches of its
box, and an estimate of that box's own intersection over union.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from pomona.skills.perception.detection.close_look import (
    CLOSE_LOOK_OUTPUTS,
    CLOSE_LOOK_SIZE,
    check_picture,
)

STAGES = (
    # kernel, stride, expansion, channels, repeats: EfficientNet-Lite0 without its last stage of 320 channels
    (3, 1, 1, 16, 1),
    (3, 2, 6, 24, 2),
    (5, 2, 6, 40, 2),
    (3, 2, 6, 80, 3),
    (5, 1, 6, 112, 3),
    (5, 2, 6, 192, 4),
)

TAPS = (2, 4, 10, 14)
"""Blocks after which features have strides 4, 8, 16 and 32."""

FROZEN = 2
"""Blocks that keep their weights together with the stem, where the trunk was trained before: edges and colours."""

SMOOTH = 1e-3
"""Epsilon of EfficientNet-Lite's batch norms."""

RARE = -4.0
"""Initial logit of the heat: most cells hold no fruit."""

USUAL_REACH = 1.7
"""Initial logarithm of a box's reaches [cells]: 22 px of the input."""


class ConvNorm(nn.Module):
    """A convolution and its batch norm, as of `conv_norm`.

    Args:
        inputs, outputs: channels.
        kernel, stride: of the convolution.
        groups: as of `nn.Conv2d`.
        momentum: of the norm's statistics.
    """

    def __init__(
        self,
        inputs: int,
        outputs: int,
        kernel: int,
        stride: int = 1,
        groups: int = 1,
        momentum: float = 0.03,
    ) -> None:
        super().__init__()
        self.conv = nn.Conv2d(
            inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False
        )
        self.norm = nn.BatchNorm2d(outputs, eps=SMOOTH, momentum=momentum)

    def forward(self, x: Tensor) -> Tensor:
        """Features (n, outputs, h / stride, w / stride)."""
        return conv_norm(self.conv, self.norm, x)


def conv_norm(conv: nn.Conv2d, norm: nn.BatchNorm2d, x: Tensor) -> Tensor:
    """Return the norm of a convolution; with fixed statistics, one convolution with the norm folded in."""
    if norm.training:
        return norm(conv(x))  # type: ignore[no-any-return]
    assert norm.running_mean is not None
    assert norm.running_var is not None
    gain = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    weight = conv.weight * gain[:, None, None, None]
    bias = norm.bias - norm.running_mean * gain
    return functional.conv2d(x, weight, bias, conv.stride, conv.padding, 1, conv.groups)


class _Block(nn.Module):
    """An inverted residual block: expand, convolve each channel by itself, project."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        hidden = inputs * expansion
        self.expand = ConvNorm(inputs, hidden, 1) if expansion > 1 else None
        self.depthwise = ConvNorm(hidden, hidden, kernel, stride, groups=hidden)
        self.project = ConvNorm(hidden, outputs, 1)
        self.skips = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = x if self.expand is None else functional.relu6(self.expand(x))
        y = self.project(functional.relu6(self.depthwise(y)))
        return x + y if self.skips else y  # type: ignore[no-any-return]


class Trunk(nn.Module):
    """EfficientNet-Lite0's stem and first fifteen blocks."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = ConvNorm(3, 32, 3, 2)
        self.blocks = nn.ModuleList()
        inputs = 32
        for kernel, stride, expansion, outputs, repeats in STAGES:
            for number in range(repeats):
                self.blocks.append(
                    _Block(inputs, outputs, kernel, stride if number == 0 else 1, expansion)
                )
                inputs = outputs

    def forward(self, x: Tensor) -> list[Tensor]:
        """Features at strides 4, 8, 16 and 32 of normalised pictures (n, 3, h, w)."""
        x = functional.relu6(self.stem(x))
        taps = []
        for number, block in enumerate(self.blocks):
            x = block(x)
            if number in TAPS:
                taps.append(x)
        return taps


class _Mix(nn.Module):
    """A convolution of neighbours, each channel by itself, and one of channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.depthwise = ConvNorm(channels, channels, 5, groups=channels)
        self.pointwise = ConvNorm(channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu6(self.pointwise(functional.relu6(self.depthwise(x))))


class FinderNetwork(nn.Module):
    """Heat, box and box quality for every cell of 4 × 4 pixels.

    Input (n, 3, h, w) in 0..1 minus 0.5, RGB, h and w multiples of 32. Output (n, 6, h/4, w/4), rows as named in
    `outputs`: logit of the heat; logarithms of the reaches of the visible part's box from the cell's middle to the
    left, up, right and down [cells]; logit of the box's expected intersection over union.
    """

    def __init__(self) -> None:
        super().__init__()
        self.trunk = Trunk()
        widths = (48, 64, 96, 128)
        taps = (24, 40, 112, 192)
        self.lateral = nn.ModuleList(
            ConvNorm(tap, width, 1) for tap, width in zip(taps, widths, strict=True)
        )
        self.down = nn.ModuleList(ConvNorm(widths[k + 1], widths[k], 1) for k in range(3))
        self.mix = nn.ModuleList([ConvNorm(48, 48, 3), ConvNorm(64, 64, 3), _Mix(96), _Mix(128)])
        self.head = ConvNorm(48, 64, 3)
        self.last = nn.Conv2d(64, 6, 1)
        nn.init.normal_(self.last.weight, std=0.01)
        assert self.last.bias is not None
        with torch.no_grad():
            self.last.bias.copy_(torch.tensor([RARE, *[USUAL_REACH] * 4, 0.0]))
        self.trained_trunk = False

    def forward(self, x: Tensor) -> Tensor:
        """Return maps of pictures (n, 3, h, w)."""
        taps = self.trunk((255.0 * x + 0.5) / 128.0)  # the trunk learnt from (value - 127) / 128
        above: Tensor | None = None
        for k in (3, 2, 1, 0):
            here = functional.relu6(self.lateral[k](taps[k]))
            if above is not None:
                wider = functional.relu6(self.down[k](above))
                here = here + functional.interpolate(wider, scale_factor=2.0, mode="nearest")
            above = functional.relu6(self.mix[k](here))
        assert above is not None
        return self.last(functional.relu6(self.head(above)))  # type: ignore[no-any-return]

    def keep_trunk(self) -> None:
        """Keep the trunk's statistics and its first blocks as they are from here on: it was trained before."""
        self.trained_trunk = True
        for part in (self.trunk.stem, *self.trunk.blocks[:FROZEN]):
            part.requires_grad_(False)
        self.train(self.training)

    def train(self, mode: bool = True) -> FinderNetwork:
        """As of any network; a trunk that was trained before keeps its statistics."""
        super().train(mode)
        if self.trained_trunk:
            self.trunk.eval()
        return self


class _Convolve(nn.Sequential):
    """A convolution, its batch norm and a rectifier."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        )

    def forward(self, x: Tensor) -> Tensor:
        conv, norm, rectifier = self
        return rectifier(conv_norm(conv, norm, x))  # type: ignore[no-any-return, arg-type]


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _Convolve(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        # In place: a tenth of a training step's time.
        return functional.relu_(conv_norm(self.second, self.norm, self.first(x)).add_(x))


class CloseLookNetwork(nn.Module):
    """Place, size and stem axis of the one fruit in the middle of a square picture.

    Input (n, 3, 96, 96) in 0..1 minus 0.5. Output (n, 11), named by the constants `CENTRE` to `SEEN`: the centroid
    relative to the middle in half sides, the logarithm of the size in half sides, the stem axis in the frame of the
    ray through the fruit, log spreads of these three, the logit of being fruit, and the logit of visibility.

    The picture is folded into blocks of 4 x 4 pixels first: layers of few channels at full size take more time than
    all others together, without more information.
    """

    def __init__(self, widths: tuple[int, int, int, int, int] = (64, 128, 160, 48, 192)) -> None:
        super().__init__()
        a, b, c, squeezed, hidden = widths
        self.widths = widths
        self.trunk = nn.Sequential(
            nn.PixelUnshuffle(4),
            _Convolve(48, a),
            _Residual(a),
            _Convolve(a, b, 3, 2),
            _Residual(b),
            _Residual(b),
            _Residual(b),
            _Convolve(b, c, 3, 2),
            _Residual(c),
            _Residual(c),
            _Convolve(c, squeezed, 1),
        )
        cells = CLOSE_LOOK_SIZE // 16
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Linear(squeezed * cells * cells, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, CLOSE_LOOK_OUTPUTS),
        )

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs for each look, shape (n, 3, side, side)."""
        return self.head(self.trunk(x))  # type: ignore[no-any-return]


def to_input(pictures: Tensor) -> Tensor:
    """uint8 pictures (n, h, w, 3) to a network's input (n, 3, h, w), channels last in memory."""
    return pictures.permute(0, 3, 1, 2).to(torch.float32).mul_(1.0 / 255.0).sub_(0.5)


STRIDE = 8  # input pixels per cell of the maps

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)

BELIEF_MAPS = 9
AFFINITY_MAPS = 16
DOPE_STAGES = 6
_VGG_WIDTHS = (64, 64, 0, 128, 128, 0, 256, 256, 256, 256, 0, 512, 512, 256, 128)  # 0: halving


class DopeNetwork(nn.Module):
    """Six stages of belief (9) and affinity (16) maps on VGG-19 features; 50 267 350 parameters.

    Input: RGB minus ImageNet's mean over its deviation, (n, 3, h, w). Output: two lists with one tensor a stage,
    belief (n, 9, h/8, w/8) and affinity (n, 16, h/8, w/8).
    """

    def __init__(self) -> None:
        super().__init__()
        self.vgg = _features()
        self.m1_2 = _first_stage(BELIEF_MAPS)
        self.m1_1 = _first_stage(AFFINITY_MAPS)
        inputs = 128 + BELIEF_MAPS + AFFINITY_MAPS
        for stage in range(2, DOPE_STAGES + 1):
            self.add_module(f"m{stage}_2", _later_stage(inputs, BELIEF_MAPS))
            self.add_module(f"m{stage}_1", _later_stage(inputs, AFFINITY_MAPS))

    def forward(self, x: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Belief and affinity maps after each stage, shapes (n, 9, h / 8, w / 8) and (n, 16, h / 8, w / 8)."""
        features = self.vgg(x)
        beliefs = [self.m1_2(features)]
        affinities = [self.m1_1(features)]
        for stage in range(2, DOPE_STAGES + 1):
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
        colour = np.asarray(
            cv2.resize(colour, (int(width * factor), int(height * factor))), np.uint8
        )
    scaled = (
        torch.from_numpy(np.ascontiguousarray(colour)).permute(2, 0, 1).to(torch.float32) / 255.0
    )
    mean = torch.tensor(IMAGENET_MEAN).view(3, 1, 1)
    std = torch.tensor(IMAGENET_STD).view(3, 1, 1)
    return ((scaled - mean) / std)[None], factor


def _features() -> nn.Sequential:
    layers: list[nn.Module] = []
    channels = 3
    for width in _VGG_WIDTHS:
        if width == 0:
            layers.append(nn.MaxPool2d(2, 2))
            continue
        layers += [nn.Conv2d(channels, width, 3, padding=1), nn.ReLU(inplace=True)]
        channels = width
    return nn.Sequential(*layers)


def _stage(widths: list[tuple[int, int, int]]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for inputs, outputs, kernel in widths:
        layers += [nn.Conv2d(inputs, outputs, kernel, padding=kernel // 2), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers[:-1])


def _first_stage(outputs: int) -> nn.Sequential:
    return _stage([(128, 128, 3)] * 3 + [(128, 512, 1), (512, outputs, 1)])


def _later_stage(inputs: int, outputs: int) -> nn.Sequential:
    return _stage([(inputs, 128, 7)] + [(128, 128, 7)] * 4 + [(128, 128, 1), (128, outputs, 1)])
