"""Speed: the arm goes slower while a part of the tree runs."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import BuildContext
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.reasons import NoValue
from pomona.executive.skill import Skill
from pomona.executive.speed import SHARE, SpeedRefusedError, checked_speed


class Slower(Wrapper):
    """Gives the skills below it a share of the speed at which they move the arm, looked up at each start."""

    def __init__(self, name: str, child: Behaviour, share: Callable[[], float]) -> None:
        super().__init__(name, child)
        self._share, self._now = share, 1.0
        for behaviour in child.iterate():
            if isinstance(behaviour, Skill):
                behaviour.slowed_by.append(lambda: self._now)

    def begin(self) -> Status | None:
        try:
            self._now = checked_speed(self._share())
        except SpeedRefusedError as error:
            raise NoValue(f"{self.name}: {error}") from None
        return None


class SpeedType(Modifier):
    """moves the arm inside at a ratio of its speed, from 10 % to 100 %; nested speeds multiply"""

    key, symbol = "speed", "»"
    value = takes.Value(SHARE, "share of the speed that the skills command")

    def build(self, at: BuildContext) -> Behaviour:
        return Slower(at.name, at.inside(), at.value(self.key))
