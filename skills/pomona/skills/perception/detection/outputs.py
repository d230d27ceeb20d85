"""Inputs and outputs of the two networks: strides, units and columns, without the networks themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pomona.executive.values.arrays import Float32

Network = Callable[[Float32], Sequence[Float32]]
"""Runs a network: pictures (n, 3, h, w), RGB in 0..1 minus 0.5, to its outputs."""

FINDER_STRIDE = 4
"""Input pixels per cell of the belief maps."""

OFFSET_UNIT = 8.0
"""Offsets are learnt in units of this many cells."""

CLOSE_LOOK_SIZE = 96
"""Side of the square picture of one fruit [px]."""

CENTRE, SIZE, AXIS, SPREAD, KIND, SEEN, BOX = slice(0, 2), 2, slice(3, 6), slice(6, 9), 9, 10, slice(11, 15)
"""Columns of the close look's output; older weights have none for the box."""

LEAST_OUTPUTS, ALL_OUTPUTS = SEEN + 1, BOX.stop

USUAL_BOX = 0.307
"""Log of a whole fruit's box over the look's half side, where a network without boxes begins to learn them."""
