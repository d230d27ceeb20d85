"""The finder: places of fruit in a picture, and the box around the visible part of each.

EfficientNet-Lite0 (Tan and others, 2020; stages 1 to 6 of it) as trunk, a pyramid of features above it (Lin and
others, 2017), and heads as in CenterNet (Zhou and others, 2019): a heat map with one peak per fruit, the reaches of its
box, and an estimate of that box's own intersection over union.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

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
        self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1, momentum: float = 0.03
    ) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)
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
                self.blocks.append(_Block(inputs, outputs, kernel, stride if number == 0 else 1, expansion))
                inputs = outputs

    def forward(self, x: Tensor) -> list[Tensor]:
        """Features at strides 4, 8, 16 and 32 of normalised pictures (n, 3, h, w)."""
        x, taps = functional.relu6(self.stem(x)), []
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
        widths, taps = (48, 64, 96, 128), (24, 40, 112, 192)
        self.lateral = nn.ModuleList(ConvNorm(tap, width, 1) for tap, width in zip(taps, widths, strict=True))
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
