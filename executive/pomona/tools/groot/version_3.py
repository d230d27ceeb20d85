"""Elements of BehaviorTree.CPP's version 3 → those of version 4, where the file does not declare its version."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pomona.tools.groot.xml_nodes import XmlElement

_OLD_TAGS = re.compile(
    r"SubTreePlus|SequenceStar|FallbackStar|RetryUntilSuccesful|BlackboardCheck\w+"
)
_OLD_ATTRIBUTES = {
    "SubTree": ("__shared_blackboard",),
    "Parallel": ("success_threshold", "failure_threshold", "threshold"),
}
"""Words that version 4 does not have: a file with one of them is of version 3."""
_NEW_TAGS = re.compile(
    r"Script|ScriptCondition|Precondition|RunOnce|Loop\w+|AsyncSequence|AsyncFallback|ParallelAll|TryCatch"
)
_NEW_ATTRIBUTES = re.compile(
    r"_autoremap|_skipIf|_successIf|_failureIf|_while|_on[A-Z]\w+|_post|success_count|failure_count"
)
"""Words that version 3 does not have."""
KEY = re.compile(r"[A-Za-z_]\w*")
"""A text that version 3 takes for a key and version 4 for a text, where a subtree is called."""


def modernise(root: XmlElement) -> str:
    """Write the trees of a file of version 3 in the words of version 4.

    Returns:
        "3" or "4", as the words of the file show; "" if none does.
    """
    elements = [element for tree in root.all("BehaviorTree") for element in _below(tree)]
    if not any(_is_old(element) for element in elements):
        return "4" if any(_is_new(element) for element in elements) else ""
    for element in elements:
        attributes = element.attributes
        if element.tag == "SubTree":
            for name, text in attributes.items():
                if name not in ("ID", "name") and not name.startswith("_") and KEY.fullmatch(text):
                    attributes[name] = f"{{{text}}}"
        elif element.tag == "SubTreePlus":
            element.tag = "SubTree"
        elif element.tag == "Parallel" or (
            element.tag == "Control" and element.get("ID") == "Parallel"
        ):
            _parallel(attributes, len(element.children))
    return "3"


def _parallel(attributes: dict[str, str], children: int) -> None:
    """Rename the thresholds. The one of version 3.5 lets the node fail when too few children are left to succeed."""
    if "threshold" in attributes and "success_threshold" not in attributes:
        count = attributes["success_count"] = attributes.pop("threshold")
        attributes["failure_count"] = str(children - int(count) + 1) if count.isdecimal() else "1"
    for name in ("success", "failure"):
        if f"{name}_threshold" in attributes and f"{name}_count" not in attributes:
            attributes[f"{name}_count"] = attributes.pop(f"{name}_threshold")


def _is_old(element: XmlElement) -> bool:
    words = _OLD_ATTRIBUTES.get(element.get("ID") if element.tag == "Control" else element.tag, ())
    return bool(_OLD_TAGS.fullmatch(element.tag)) or any(
        word in element.attributes for word in words
    )


def _is_new(element: XmlElement) -> bool:
    wired = element.tag == "SubTree" and any(
        text.startswith("{") for text in element.attributes.values()
    )
    return (
        wired
        or bool(_NEW_TAGS.fullmatch(element.tag))
        or any(map(_NEW_ATTRIBUTES.fullmatch, element.attributes))
    )


def _below(element: XmlElement) -> Iterator[XmlElement]:
    for child in element.children:
        yield child
        yield from _below(child)
