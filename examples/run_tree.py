"""Run a tree file from Python. Run: python examples/run_tree.py [--dry]

With --dry each skill is a mock that succeeds at once. Without it the simulated cell picks an apple.
Needs the distribution pomona.
"""

import sys
from pathlib import Path

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged


def on_event(event: Event) -> None:
    """Print each node that ends."""
    if isinstance(event, NodeChanged) and event.status in ("SUCCESS", "FAILURE"):
        print(f"{event.t:6.2f} s  {event.status:<8} {event.path}")


if __name__ == "__main__":  # computations run in processes of their own
    order = RunOrder(
        tree=find_tree("pick_apple"),
        cell=find_cell("sim"),
        seed=3,
        settings={"attempts": "2"},
        record=Path("runs"),
        dry="--dry" in sys.argv,
    )
    executed = execute(order, [on_event])
    print(
        f"{executed.result.outcome} after {executed.result.time:.2f} s, record in {executed.record}"
    )
