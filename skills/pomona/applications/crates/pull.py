"""A fruit drawn across in steps: places of the finger, which follows a point of the rolling ball, and the end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pomona.applications.crates.hooks import pull_of, rolled_height
from pomona.drivers import HARD_MODULUS
from pomona.executive import Float64
from pomona.skills import bruising
from pomona.skills.motion import Grasp

RELIEF = 0.1e-3
"""Way by which a finger gives way at a time [m]: 0.5 to 1 N, less than what holds by friction."""
DOWNWARDS = 1.5
"""Force downwards from which a finger gives way [N]: it holds a fruit on its base, and wedges it in a corner."""
FARTHEST_OFF = 3e-3
"""Farthest from the way of a rolling ball [m]: a fruit that does not roll is not to be slid over."""
STEP = 3e-3
"""Of a pull, after which the finger gives way [m]."""
LEAST = 0.3
"""Change of force that shows a fruit at the finger [N]; the fingers' noise is 0.2 N."""
LOWER = 1.2e-3
LOWERED = 2
"""How far the finger stays below the way of a rolling ball in each of the first steps [m]: it presses into the flank.
An apple on the ring of its base tips with a jerk, and a finger that rises before slides over its shoulder."""
HITS = 8
"""Steps in succession that end at the limit of something that holds the fruit: it starts to roll with a jerk."""
HARDER = 1.5
"""By which the limit grows with each of these steps [N]; a step that the fruit follows sets it back."""
BEARS = 0.75
"""Largest limit of a step over the force that bruises the fruit."""
ENOUGH = 0.015
"""A pull that ended at its force after this distance has made room [m]: a finger is 12 mm thick."""


def bears_at_pads(hook: Grasp) -> float:
    """Return the largest limit of a step [N]."""
    return BEARS * bruising(hook.fruit)


def bears_at_edges(hook: Grasp) -> float:
    """Return the force of the fingers' edges that ends a pull [N]: they are hard, and bruise a fruit before the pads."""
    return BEARS * bruising(hook.fruit, HARD_MODULUS)


class HookPull:
    """A pull from the place at which the finger touches the fruit.

    Attributes:
        came: distance that the finger came without reaching the limit [m].
        off: height of the finger over the way of a rolling ball, by giving way [m].
        limit: force that ends the next step [N]; most: largest change of force in a step [N].
    """

    def __init__(self, hook: Grasp, p_start: Float64, limit: float) -> None:
        """Begin at a place of the tool, shape (3,) [m]; `limit` is the force that ends a step [N], at first."""
        self._start, self._along = p_start, pull_of(hook)
        self._first, self._most = limit, max(limit, bears_at_pads(hook))
        self._radius = float(hook.fruit.dimensions.min()) / 2.0
        self._behind = hook.width / 2.0 - float(
            (p_start - hook.fruit.T_base_fruit[:3, 3]) @ self._along
        )
        self._hits = 0
        self._begins = True
        self.came = self.off = self.most = 0.0
        self.limit = limit

    @property
    def blocked(self) -> str:
        """The sentence about a pull that has ended before it made room."""
        return f"the pull ended after {1e3 * self.came:.0f} mm at {self.most:.1f} N: something is in front of the fruit"

    def places(self, distance: float) -> Iterator[tuple[float, Float64]]:
        """Yield the distance [m] and the place of the tool, shape (3,) [m], at the end of each step."""
        for x in np.arange(STEP, distance + STEP / 2.0, STEP):
            self._begins = bool(x < (LOWERED + 0.5) * STEP)
            self.off -= LOWER * self._begins
            height = self.off + rolled_height(x, self._radius, self._behind)
            yield float(x), self._start + x * self._along + [0.0, 0.0, height]

    @property
    def is_held(self) -> bool:
        """Whether the last step ended at its limit, or it is one of the first."""
        return self._hits > 0 or self._begins

    def ends(self, x: float, at_limit: bool, change: float, down: float) -> bool:
        """Take a step, and return True when something holds the fruit: `HITS` limits, or a finger that cannot rise.

        Args:
            x: distance at the end of the step [m].
            at_limit: the step ended at the limit.
            change: largest change of force in the step [N].
            down: force downwards that is left [N].
        """
        self.most = max(self.most, change)
        self._hits = self._hits + 1 if at_limit else 0
        self.limit = min(self._first + HARDER * self._hits, self._most)
        if self._hits >= HITS or (down > DOWNWARDS and self.off > FARTHEST_OFF - RELIEF):
            return True
        self.came = self.came if at_limit else x
        return False
