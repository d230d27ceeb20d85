"""Elements of BehaviorTree.CPP's version 3 → those of version 4, where the file does not declare its version."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pomona.tools.groot.xml_nodes import XmlElement

_TAGS = re.compile(r"SubTreePlus|SequenceStar|FallbackStar|RetryUntilSuccesful|BlackboardCheck\w+")
_ATTRIBUTES = {
    "SubTree": ("__shared_blackboard",),
    "Parallel": ("success_threshold", "failure_threshold", "threshold"),
}
"""Words that version 4 does not have: a file with one of them is of version 3."""
KEY = re.compile(r"[A-Za-z_]\w*")
"""A text that version 3 takes for a key and version 4 for a text, where a subtree is called."""


def modernise(root: XmlElement) -> None:
    """Write the trees of a file in the words of version 4; a file without words of version 3 stays as it is."""
    elements = [element for tree in root.all("BehaviorTree") for element in _below(tree)]
    if not any(_is_old(element) for element in elements):
        return
    for element in elements:
        attributes = element.attributes
        if element.tag == "SubTree":
            for name, text in attributes.items():
                if name not in ("ID", "name") and not name.startswith("_") and KEY.fullmatch(text):
                    attributes[name] = f"{{{text}}}"
        elif element.tag == "SubTreePlus":
            element.tag = "SubTree"
        elif element.tag == "Parallel" or (element.tag == "Control" and element.get("ID") == "Parallel"):
            _parallel(attributes, len(element.children))


def _parallel(attributes: dict[str, str], children: int) -> None:
    """Rename the thresholds. The one of version 3.5 lets the node fail when too few children are left to succeed."""
    if attributes.get("threshold", "").isdecimal() and "success_threshold" not in attributes:
        attributes["success_count"] = attributes.pop("threshold")
        attributes["failure_count"] = str(children - int(attributes["success_count"]) + 1)
    for name in ("success", "failure"):
        if f"{name}_threshold" in attributes and f"{name}_count" not in attributes:
            attributes[f"{name}_count"] = attributes.pop(f"{name}_threshold")


def _is_old(element: XmlElement) -> bool:
    words = _ATTRIBUTES.get(element.get("ID") if element.tag == "Control" else element.tag, ())
    return bool(_TAGS.fullmatch(element.tag)) or any(word in element.attributes for word in words)


def _below(element: XmlElement) -> Iterator[XmlElement]:
    for child in element.children:
        yield child
        yield from _below(child)
