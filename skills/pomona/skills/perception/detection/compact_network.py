"""The compact detector: a small belief-map network for the whole picture, and a second look at each fruit.

`FinderNetwork` is of DOPE's family: nine belief maps (eight corners and the centroid), with centroid-to-corner offsets
in place of DOPE's affinity fields. `CloseLookNetwork` sees one fruit at a time at full resolution.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from pomona.skills.perception.detection.outputs import ALL_OUTPUTS, BOX, CLOSE_LOOK_SIZE, USUAL_BOX

USUAL_REACH = 5.0
"""How far a fruit reaches from its middle before a finder has learnt boxes [cells]."""

STEEPNESS, EVEN_BELIEF = 8.0, 0.4
"""A belief of older weights b becomes the logit STEEPNESS (b - EVEN_BELIEF)."""


def _convolve(inputs: int, outputs: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _convolve(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)

    def forward(self, x: Tensor) -> Tensor:
        # In place: a tenth of a training step's time.
        return functional.relu_(self.norm(self.second(self.first(x))).add_(x))


class FinderNetwork(nn.Module):
    """Belief maps and corner offsets of all fruit in a picture.

    Input (n, 3, h, w) in 0..1 minus 0.5, h and w multiples of 16. Output: belief maps (n, 9, h/4, w/4) and offsets
    (n, 17, h/4, w/4): (du, dv) from the centroid to corners 0..7, and the logarithm of the corners' mean distance from
    it, all in units of `OFFSET_UNIT` cells. The distance is learnt by itself because corners of a fruit whose turn is
    unclear are drawn to their mean, and would make it look small.

    With `boxes` there is a third output (n, 4, h/4, w/4): how far what is seen of the fruit reaches to the left, up, to
    the right and down of this cell, in cells; and the centroid's belief is a probability. Older weights have neither.
    """

    def __init__(self, widths: tuple[int, int, int, int] = (24, 48, 96, 160), boxes: bool = True) -> None:
        super().__init__()
        a, b, c, d = widths
        self.widths, self.boxes = widths, boxes
        self.stem = nn.Sequential(_convolve(3, a, 5, 2), _convolve(a, b, 3, 2))
        self.at_4 = _Residual(b)
        self.at_8 = nn.Sequential(_convolve(b, c, 3, 2), _Residual(c), _Residual(c))
        self.at_16 = nn.Sequential(_convolve(c, d, 3, 2), _Residual(d), _Residual(d))
        self.to_8 = nn.Conv2d(d, c, 1)
        self.up_8 = _Residual(c)
        self.to_4 = nn.Conv2d(c, b, 1)
        self.up_4 = _Residual(b)
        last = nn.Conv2d(b, 9 + 17, 1)
        nn.init.normal_(last.weight, std=0.01)
        self.head = nn.Sequential(_convolve(b, b), last)
        if boxes:
            reach = nn.Conv2d(b, 4, 1)
            nn.init.normal_(reach.weight, std=0.01)
            assert reach.bias is not None
            nn.init.constant_(reach.bias, math.log(USUAL_REACH))
            self.box_head = nn.Sequential(_convolve(b, b), reach)

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """Belief maps, offsets and, where it knows them, boxes of pictures, shape (n, 3, h, w)."""
        fine = self.at_4(self.stem(x))
        middle = self.at_8(fine)
        coarse = self.to_8(self.at_16(middle))
        middle = self.up_8(middle + functional.interpolate(coarse, scale_factor=2.0, mode="nearest"))
        fine = self.up_4(fine + functional.interpolate(self.to_4(middle), scale_factor=2.0, mode="nearest"))
        maps = self.head(fine)
        if not self.boxes:
            return maps[:, :9], maps[:, 9:]
        belief = torch.cat([maps[:, :8].float(), maps[:, 8:9].float().sigmoid()], dim=1)
        return belief, maps[:, 9:], self.box_head(fine).float().clamp(-4.0, 5.0).exp()


class CloseLookNetwork(nn.Module):
    """Place, size and stem axis of the one fruit in the middle of a square picture.

    Input (n, 3, 96, 96) in 0..1 minus 0.5. Output (n, 15), named by the constants `CENTRE` to `BOX`: the centroid
    relative to the middle in half sides, the logarithm of the size in half sides, the stem axis in the frame of the
    ray through the fruit, log spreads of these three, the logit of being fruit, the logit of visibility, and of the
    box around what is seen the middle and the logarithms of width and height, all in half sides.

    The picture is folded into blocks of 4 x 4 pixels first: layers of few channels at full size take more time than
    all others together, and say no more.
    """

    def __init__(
        self, widths: tuple[int, int, int, int, int] = (64, 128, 160, 48, 192), outputs: int = ALL_OUTPUTS
    ) -> None:
        super().__init__()
        a, b, c, squeezed, hidden = widths
        self.widths = widths
        self.trunk = nn.Sequential(
            nn.PixelUnshuffle(4),
            _convolve(48, a),
            _Residual(a),
            _convolve(a, b, 3, 2),
            _Residual(b),
            _Residual(b),
            _Residual(b),
            _convolve(b, c, 3, 2),
            _Residual(c),
            _Residual(c),
            _convolve(c, squeezed, 1),
        )
        cells = CLOSE_LOOK_SIZE // 16
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Linear(squeezed * cells * cells, hidden),
            nn.ReLU(inplace=True),
            nn.Linear(hidden, outputs),
        )

    def forward(self, x: Tensor) -> Tensor:
        """What is said of each look, shape (n, 3, side, side)."""
        return self.head(self.trunk(x))  # type: ignore[no-any-return]


def finder_with_boxes(network: FinderNetwork) -> FinderNetwork:
    """A finder that knows boxes, to be taught them, with this one's weights; its belief starts as a steeper one."""
    if network.boxes:
        return network
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)  # what is new begins the same each time, so that a run can be repeated
        twin = FinderNetwork(network.widths)
    state = network.state_dict()
    twin.load_state_dict(twin.state_dict() | state)
    last = twin.head[-1]
    assert isinstance(last, nn.Conv2d)
    assert last.bias is not None
    with torch.no_grad():
        last.weight[8] *= STEEPNESS
        last.bias[8] = STEEPNESS * (last.bias[8] - EVEN_BELIEF)
    return twin.train(network.training)


def with_boxes(network: CloseLookNetwork) -> CloseLookNetwork:
    """A network that says the same as this one and, where it said none, always the usual box."""
    wide = CloseLookNetwork(network.widths)
    last, before = wide.head[-1], network.head[-1]
    assert isinstance(last, nn.Linear)
    assert isinstance(before, nn.Linear)
    state, count = dict(network.state_dict()), before.out_features
    if count < ALL_OUTPUTS:
        weight, bias = torch.zeros_like(last.weight), torch.zeros_like(last.bias)
        bias[BOX.start + 2 :] = USUAL_BOX
        weight[:count], bias[:count] = before.weight, before.bias
        name = f"head.{len(wide.head) - 1}"
        state |= {f"{name}.weight": weight.detach(), f"{name}.bias": bias.detach()}
    wide.load_state_dict(state)
    return wide.train(network.training)


def to_input(pictures: Tensor) -> Tensor:
    """uint8 pictures (n, h, w, 3) to a network's input (n, 3, h, w), channels last in memory."""
    return pictures.permute(0, 3, 1, 2).to(torch.float32).mul_(1.0 / 255.0).sub_(0.5)
