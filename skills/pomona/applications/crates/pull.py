"""A fruit drawn across in steps: places of the finger, which follows a point of the rolling ball, and the end."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pomona.applications.crates.hooks import pull_of, rolled_height
from pomona.drivers import HARD_MODULUS
from pomona.executive import Float64
from pomona.skills import bruising
from pomona.skills.motion import Grasp

RELIEF = 0.1e-3
"""Way by which a finger gives way at a time [m]: 0.5 to 1 N, less than what holds by friction."""
DOWNWARDS = 0.8
"""Force downwards from which a finger gives way [N]: it holds a fruit on its base, and wedges it in a corner."""
FARTHEST_OFF = 3e-3
"""Farthest from the way of a rolling ball [m]: a fruit that does not roll is not to be slid over."""
STEP = 3e-3
"""Of a pull, after which the finger gives way [m]."""
LEAST = 0.3
"""Change of force that shows a fruit at the finger [N]; the fingers' noise is 0.2 N."""
FIRST = 0.004
"""Way in which a fruit begins to roll [m]: an apple on the ring of its base tips with a jerk."""
FOLLOWS = 0.3e-3
"""Least way of a step that ends at its limit in which the fruit followed [m]: the rubber gives way by less."""
HITS = 12
"""Steps in succession that end at the limit of something that holds the fruit: it starts to roll with a jerk."""
HARDER = 0.3
"""By which the limit grows with each of these steps [N]; a step that the fruit follows sets it back."""
BEARS = 0.75
"""Largest force of the fingers' edges over the one that bruises the fruit."""
LEAST_LIMIT = 0.5
"""Least limit of a step [N]."""
GRAVITY = 9.81  # [m/s²]
ENOUGH = 0.015
"""A pull that ended at its force after this distance has made room [m]: a finger is 12 mm thick."""


def weight_of(hook: Grasp) -> float:
    """Return the fruit's weight [N], or half of the force that bruises it if its kind was not weighed."""
    known = hook.fruit.mass
    return GRAVITY * known[0] if known else 0.5 * bruising(hook.fruit, HARD_MODULUS)


def bears_below(hook: Grasp) -> float:
    """Return the largest limit of a step [N]: weight and finger press the fruit onto a hard floor, and draw it there."""
    most = bruising(hook.fruit, HARD_MODULUS)
    return math.sqrt(max(LEAST_LIMIT**2, most**2 - (weight_of(hook) + DOWNWARDS) ** 2))


def bears_at_edges(hook: Grasp) -> float:
    """Return the force of the fingers' edges that ends a pull [N]: they are hard, and bruise a fruit before the pads."""
    return BEARS * bruising(hook.fruit, HARD_MODULUS)


class HookPull:
    """A pull from the place at which the finger touches the fruit.

    Attributes:
        way: distance that the finger came [m]; came: the same without reaching the limit, so that the fruit came along.
        off: height of the finger over the way of a rolling ball, by giving way [m].
        limit: force that ends the next step [N]; most: largest change of force in a step [N].
    """

    def __init__(self, hook: Grasp, p_start: Float64, limit: float) -> None:
        """Begin at a place of the tool, shape (3,) [m]; `limit` is the force that ends a step [N], at first."""
        self._start, self._along = p_start, pull_of(hook)
        self._most = bears_below(hook)
        self._first = min(limit, self._most)
        self._radius = float(hook.fruit.dimensions.min()) / 2.0
        self._behind = hook.width / 2.0 - float(
            (p_start - hook.fruit.T_base_fruit[:3, 3]) @ self._along
        )
        self._hits = 0
        self.way = self.came = self.off = self.most = 0.0
        self.limit = self._first

    @property
    def blocked(self) -> str:
        """The sentence about a pull that has ended before it made room."""
        return f"the pull ended after {1e3 * self.came:.0f} mm at {self.most:.1f} N: something holds it, or more bruises it"

    def places(self, distance: float) -> Iterator[Float64]:
        """Yield the place of the tool at the end of the next step, shape (3,) [m]; `ends` takes each."""
        while self.way < distance - FOLLOWS:
            x = min(self.way + STEP, distance)
            height = self.off + rolled_height(x, self._radius, self._behind)
            yield self._start + x * self._along + [0.0, 0.0, height]

    @property
    def is_held(self) -> bool:
        """Whether the fruit did not follow in the last step, or it is one of the first."""
        return self._hits > 0 or self.way < FIRST

    def ends(self, place: Float64, at_limit: bool, change: float, down: float) -> bool:
        """Take a step, and return True when something holds the fruit: `HITS` limits, or a finger that cannot rise.

        Args:
            place: of the tool after the step, shape (3,) [m].
            at_limit: the step ended at the limit.
            change: largest change of force in the step [N].
            down: force downwards that is left [N].
        """
        self.most = max(self.most, change)
        before = self.way
        self.way = float((place - self._start) @ self._along)
        self.came = self.came if at_limit else self.way
        self._hits = self._hits + 1 if at_limit and self.way < before + FOLLOWS else 0
        self.limit = min(self._first + HARDER * self._hits, self._most)
        return self._hits >= HITS or (down > DOWNWARDS and self.off > FARTHEST_OFF - RELIEF)
