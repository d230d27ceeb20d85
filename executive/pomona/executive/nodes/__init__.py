"""The words of the tree language, one class each: syntax, data flow, failure codes, behaviour, drawing, XML.

The behaviours are py_trees behaviours. They explain their failures (`explain`), read time from the run, and take values
that are known only at their start.
"""

from pomona.executive.nodes import takes
from pomona.executive.nodes.catalogue import NodeTypeError, NodeTypes
from pomona.executive.nodes.node_type import Composite, Leaf, Modifier, NodeType, TreeNode
from pomona.executive.nodes.retry import Attempt, Retry

__all__ = [
    "Attempt",
    "Composite",
    "Leaf",
    "Modifier",
    "NodeType",
    "NodeTypeError",
    "NodeTypes",
    "Retry",
    "TreeNode",
    "takes",
]
