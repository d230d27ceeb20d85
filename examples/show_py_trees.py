"""A tree of plain py_trees behaviours on Pomona's page, with a record. Run: python examples/show_py_trees.py [--page]

With --page the link of the page is printed. `pomona explain last` reads the record.
Needs the distribution pomona or pomona-executive.
"""

import sys

import py_trees
from py_trees.common import Status

from pomona.executive import run_behaviour


class Count(py_trees.behaviour.Behaviour):
    """Succeed or fail after a number of ticks."""

    def __init__(self, name: str, ticks: int, end: Status = Status.SUCCESS) -> None:
        super().__init__(name)
        self.ticks = ticks
        self.left = ticks
        self.end = end

    def initialise(self) -> None:
        self.left = self.ticks

    def update(self) -> Status:
        self.left -= 1
        self.feedback_message = f"{self.left} ticks left"
        return Status.RUNNING if self.left > 0 else self.end


look = Count("look", 10)
grasp = py_trees.composites.Selector("grasp", memory=True)
grasp.add_children([Count("from above", 15, Status.FAILURE), Count("from the side", 20)])
root = py_trees.composites.Sequence("fetch", memory=True, children=[look, grasp])

executed = run_behaviour(root, dashboard="--page" in sys.argv)
print(f"{executed.result.outcome} after {executed.result.time:.1f} s, record in {executed.record}")
