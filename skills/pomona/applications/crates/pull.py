"""A fruit drawn across in steps: places of the finger, which follows a point of the rolling ball, and the end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pomona.applications.crates.hooks import pull_of, rolled_height
from pomona.executive import Float64
from pomona.skills.motion import Grasp

RELIEF = 0.1e-3
"""Way by which a finger gives way at a time [m]: 0.5 to 1 N, less than what holds by friction."""
FARTHEST_OFF = 3e-3
"""Farthest from the way of a rolling ball [m]: a fruit that does not roll is not to be slid over."""
STEP = 3e-3
"""Of a pull, after which the finger gives way [m]."""
LEAST = 0.3
"""Change of force that shows a fruit at the finger [N]; the fingers' noise is 0.2 N."""
HITS = 4
"""Steps in succession that end at the limit of something that holds the fruit: it starts to roll with a jerk."""
ENOUGH = 0.015
"""A pull that ended at its force after this distance has made room [m]: a finger is 12 mm thick."""


class HookPull:
    """A pull from the place at which the finger touches the fruit.

    Attributes:
        came: distance that the finger came without reaching the limit [m].
        off: height of the finger over the way of a rolling ball, by giving way [m].
        most: largest change of force in a step [N].
    """

    def __init__(self, hook: Grasp, p_start: Float64, limit: float) -> None:
        """Begin at a place of the tool, shape (3,) [m]; `limit` is the force that ends a step [N]."""
        self._start, self._along, self._limit = p_start, pull_of(hook), limit
        self._radius = float(hook.fruit.dimensions.min()) / 2.0
        self._behind = hook.width / 2.0 - float((p_start - hook.fruit.T_base_fruit[:3, 3]) @ self._along)
        self._hits = 0
        self.came = self.off = self.most = 0.0

    @property
    def blocked(self) -> str:
        """The sentence about a pull that has ended before it made room."""
        return f"the pull ended after {1e3 * self.came:.0f} mm at {self.most:.1f} N: something is in front of the fruit"

    def places(self, distance: float) -> Iterator[tuple[float, Float64]]:
        """Yield the distance [m] and the place of the tool, shape (3,) [m], at the end of each step."""
        for x in np.arange(STEP, distance + STEP / 2.0, STEP):
            height = self.off + rolled_height(x, self._radius, self._behind)
            yield float(x), self._start + x * self._along + [0.0, 0.0, height]

    def ends(self, x: float, at_limit: bool, change: float, present: float) -> bool:
        """Take a step, and return True when something holds the fruit: `HITS` limits, or a finger that cannot rise.

        Args:
            x: distance at the end of the step [m].
            at_limit: the step ended at the limit.
            change, present: largest change of force in the step, and the one that is left [N].
        """
        self.most = max(self.most, change)
        self._hits = self._hits + 1 if at_limit else 0
        if self._hits >= HITS or (present > 0.5 * self._limit and self.off > FARTHEST_OFF - RELIEF):
            return True
        self.came = self.came if at_limit else x
        return False
