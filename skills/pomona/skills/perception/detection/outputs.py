"""Inputs and outputs of the two networks: strides, units and columns, without the networks themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pomona.executive.values.arrays import Float32

Network = Callable[[Float32], Sequence[Float32]]  # pictures (n, 3, h, w), RGB in 0..1 minus 0.5, to outputs
FINDER_STRIDE = 4  # input pixels per cell of the belief maps
OFFSET_UNIT = 8.0  # offsets are learnt in units of this many cells
CLOSE_LOOK_SIZE = 96  # side of the square picture of one fruit [px]

CENTRE, SIZE, AXIS, SPREAD, KIND, SEEN = slice(0, 2), 2, slice(3, 6), slice(6, 9), 9, 10
"""Columns of the close look's output."""

CLOSE_LOOK_OUTPUTS = SEEN + 1

HEAT, REACHES, QUALITY = 0, slice(1, 5), 5
"""Rows of the finder's maps: logit of the heat, log reaches left, up, right and down [cells], logit of the quality."""

FINDER_MULTIPLE = 32  # sides of the finder's input are multiples of this [px]: its coarsest features have this stride
