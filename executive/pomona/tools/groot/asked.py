"""IfThenElse and WhileDoElse whose first child BehaviorTree.CPP ticks in a form that Pomona does not have."""

from __future__ import annotations

from pomona.tools.groot.files import Forest
from pomona.tools.groot.forms import Forms
from pomona.tools.groot.names import BUILTIN
from pomona.tools.groot.xml_nodes import XmlElement

_PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
_ONCE = frozenset(
    [
        "BehaviorTree", "SubTree", "Sequence", "AsyncSequence", "SequenceWithMemory", "Fallback", "AsyncFallback",
        "Parallel", "ParallelAll", "IfThenElse", "TryCatch", "Switch2", "Switch3", "Switch4", "Switch5", "Switch6",
        "Inverter", "ForceSuccess", "ForceFailure", "Timeout", "Delay", "RunOnce", "Precondition",
    ]
)  # fmt: skip
"""Elements that start each child once at most before they have ended or are interrupted."""
_WITH_MEMORY = ("ReactiveSequence", "ReactiveFallback")
_HOW = "write <Condition ID=…>, or name its model with --nodes, when it takes none"


class Asked:
    """The first children of a forest's IfThenElse and WhileDoElse."""

    def __init__(self, forest: Forest, forms: Forms) -> None:
        self._forest, self._forms = forest, forms
        self._again = _started_again(forest)

    def why_not(self, tag: str, element: XmlElement) -> str:
        """Why an element would mean something else here; empty when it would not."""
        if tag == "WhileDoElse" and any(map(self._may_take_time, element.children[:1])):
            return f"asks a node that may take time: the running branch would continue unattended meanwhile; {_HOW}"
        if tag != "IfThenElse" or len(element.children) != 2 or element not in self._again:
            return ""
        asked = element.children[0]
        once = "BehaviorTree.CPP keeps its failure when it is started again; give it <AlwaysFailure/> as its third child"
        if asked.tag in _WITH_MEMORY or any(name in asked.attributes for name in _PRECONDITIONS):
            return f"asks a node with a memory of its own, and has two children: {once}"
        if not asked.children and self._may_take_time(asked):
            return f"asks a node that may take time, and has two children: {once}, or {_HOW}"
        return ""

    def _may_take_time(self, element: XmlElement) -> bool:
        """Return True if it contains a foreign node that no model declares as a condition."""
        foreign = element.tag not in BUILTIN and self._forms.of_tag(element.tag) is None
        if foreign and element.tag != "Condition" and not element.children:
            return (element.get("ID") or element.tag) not in self._forest.conditions
        return any(map(self._may_take_time, element.children))


def _started_again(forest: Forest) -> set[XmlElement]:
    """Elements below something that may start them again while it runs, also through the subtrees that it calls."""
    found: set[XmlElement] = set()
    seen: set[tuple[XmlElement, bool]] = set()
    open_elements = [(tree, False) for tree in forest.trees.values()]
    while open_elements:
        element, again = open_elements.pop()
        if (element, again) in seen:
            continue
        seen.add((element, again))
        if again:
            found.add(element)
        called = forest.trees.get(element.get("ID")) if element.tag == "SubTree" else None
        below = [*element.children, *([] if called is None else [called])]
        open_elements += [(child, again or element.tag not in _ONCE) for child in below]
    return found
