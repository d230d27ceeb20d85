"""`lenient: 2`: the first failures of a run count as successes."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import Modifier, takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import BuildContext, FlowContext
from pomona.executive.nodes.facts import Ends, Names
from pomona.executive.ports import Port


class Lenient(Wrapper):
    """Ends as its child does, but for the first failures of the run."""

    def __init__(self, name: str, child: Behaviour, most: Callable[[], int]) -> None:
        super().__init__(name, child)
        self._most = most
        self.forgiven = 0

    def after(self, status: Status) -> Status:
        if status is not Status.FAILURE or self.forgiven >= self._most():
            return status
        self.forgiven += 1
        self.feedback_message = f"forgiven {self.forgiven} times"
        return Status.SUCCESS


class LenientType(Modifier):
    """forgives so many failures in a run"""

    key = "lenient"
    symbol = "~"
    value = takes.Value(Port(int, min=1), "how many failures count as successes", known=True)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success & ends.failure, ends.failure, ends.skipped)

    def build(self, at: BuildContext) -> Behaviour:
        return Lenient(at.name, at.inside(), at.value(self.key))
