"""The second look at each fruit at full resolution, and the finder of earlier weights."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.finder_network import conv_norm
from pomona.skills.perception.detection.outputs import CLOSE_LOOK_OUTPUTS, CLOSE_LOOK_SIZE, OFFSET_UNIT

LEAST_BELIEF = 1e-4  # a belief that was learnt by squared error is cut so far from 0 and 1 before its logit is taken
LEAST_REACH = 0.05  # shortest reach of a box [cells]


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


class BeliefFinder(nn.Module):
    """The finder of earlier weights: belief maps and corner offsets, of which place and size are read.

    Input and output are those of `FinderNetwork`: the logit of the centroid's belief as heat and as quality, and the
    reaches of a whole fruit of the size that was found, or, with `boxes`, of its own boxes.
    """

    def __init__(self, widths: tuple[int, int, int, int] = (24, 48, 96, 160), boxes: bool = True) -> None:
        super().__init__()
        a, b, c, d = widths
        self.widths, self.boxes = widths, boxes
        self.stem = nn.Sequential(_Convolve(3, a, 5, 2), _Convolve(a, b, 3, 2))
        self.at_4 = _Residual(b)
        self.at_8 = nn.Sequential(_Convolve(b, c, 3, 2), _Residual(c), _Residual(c))
        self.at_16 = nn.Sequential(_Convolve(c, d, 3, 2), _Residual(d), _Residual(d))
        self.to_8 = nn.Conv2d(d, c, 1)
        self.up_8 = _Residual(c)
        self.to_4 = nn.Conv2d(c, b, 1)
        self.up_4 = _Residual(b)
        self.head = nn.Sequential(_Convolve(b, b), nn.Conv2d(b, 9 + 17, 1))
        if boxes:
            self.box_head = nn.Sequential(_Convolve(b, b), nn.Conv2d(b, 4, 1))

    def forward(self, x: Tensor) -> Tensor:
        """Return maps (n, 6, h/4, w/4) of pictures (n, 3, h, w)."""
        fine = self.at_4(self.stem(x))
        middle = self.at_8(fine)
        coarse = self.to_8(self.at_16(middle))
        middle = self.up_8(middle + functional.interpolate(coarse, scale_factor=2.0, mode="nearest"))
        fine = self.up_4(fine + functional.interpolate(self.to_4(middle), scale_factor=2.0, mode="nearest"))
        maps = self.head(fine)
        belief = maps[:, 8:9]
        if self.boxes:
            return torch.cat([belief, self.box_head(fine), belief], dim=1)
        belief = belief.clamp(LEAST_BELIEF, 1.0 - LEAST_BELIEF)
        heat = torch.log(belief) - torch.log(1.0 - belief)
        # The corners' mean is the centroid; the last map is the log of their mean distance from it.
        across = OFFSET_UNIT * maps[:, 9:25:2].mean(dim=1, keepdim=True)
        down = OFFSET_UNIT * maps[:, 10:25:2].mean(dim=1, keepdim=True)
        reach = (0.5 * OFFSET_UNIT / SIZE_OF_BOX) * maps[:, 25:26].clamp(-3.0, 3.0).exp()
        reaches = torch.cat([reach - across, reach - down, reach + across, reach + down], dim=1)
        return torch.cat([heat, torch.log(reaches.clamp(min=LEAST_REACH)), heat], dim=1)


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
