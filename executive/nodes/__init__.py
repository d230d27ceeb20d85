"""Nodes that py_trees lacks, or whose behaviour would surprise the author of a tree file.

All are py_trees behaviours. They say why they failed (`explain`), read time from the run, and take values that are
known only when they start.
"""

from executive.nodes.branches import Parallel, Sequence
from executive.nodes.conditions import Check, Guard, WaitUntil, When
from executive.nodes.fallback import Fallback
from executive.nodes.leaves import Fail, SetValues, Succeed, Wait
from executive.nodes.loops import ForEach, Repeat
from executive.nodes.retry import Attempt, Retry
from executive.nodes.wrapper import Force, Invert, Subtree, Timeout, Wrapper

__all__ = [
    "Attempt",
    "Check",
    "Fail",
    "Fallback",
    "ForEach",
    "Force",
    "Guard",
    "Invert",
    "Parallel",
    "Repeat",
    "Retry",
    "Sequence",
    "SetValues",
    "Subtree",
    "Succeed",
    "Timeout",
    "Wait",
    "WaitUntil",
    "When",
    "Wrapper",
]
