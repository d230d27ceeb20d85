"""A tree as drawings show it: its nodes with their ports and modifiers in words, called subtrees in their places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pomona.executive.language.model import Document, TreeNode
from pomona.executive.nodes.calls import SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.yaml_nodes import written


@dataclass(frozen=True, slots=True)
class DrawnNode:
    """A node and the nodes below it."""

    type: NodeType  # the node's
    name: str  # its own name with its type, or its type
    ports: str  # its ports or its value, as written
    modifiers: tuple[str, ...]  # from the outside to the inside, then the node's other fields, as written
    comment: str  # its description or comment
    lead: str  # its role below its parent, if it has one: `then`, `on failure`
    branches: tuple[DrawnNode, ...]  # its children


def outline(document: Document) -> DrawnNode | None:
    """Return the main tree of a document; None when it has none. Parts that could not be read are left out."""
    main = document.main.main
    if main is None or main.root is None:
        return None
    return _Outline(document).branch(main.root, ())


@dataclass(slots=True, eq=False)
class _Outline:
    document: Document
    count: int = 0

    def branch(self, node: TreeNode, calls: tuple[str, ...], lead: str = "") -> DrawnNode:
        self.count += 1
        below = [(child, lead.removesuffix(": "), calls) for child, lead in zip(node.children, node.leads, strict=True)]
        called = self.called(node)
        # number of nodes beyond which subtrees are not drawn
        if called is not None and node.key.text not in calls and self.count < 20_000:
            below.append((called, "", (*calls, node.key.text)))
        below += [(part, slot.replace("_", " "), calls) for slot, part in node.parts.items()]
        named = node.name.text if node.name is not None else ""
        return DrawnNode(
            node.type,
            node.key.text if not named else f"{named} ({node.key.text})",
            _ports(node),
            tuple(_modifiers(node)),
            node.description or node.comment,
            lead,
            tuple(self.branch(child, inner, lead) for child, lead, inner in below),
        )

    def called(self, node: TreeNode) -> TreeNode | None:
        definition = self.document.called(node) if node.type is SUBTREE else None
        return None if definition is None else definition.root


def _ports(node: TreeNode) -> str:
    if node.ports:
        return ", ".join(f"{name}: {written(value)}" for name, (_, value) in node.ports.items())
    if not (node.type.value.nodes or node.type.value.wires) and written(node.value) not in ("", "{}"):
        return written(node.value)
    return ""


def _modifiers(node: TreeNode) -> Iterator[str]:
    fields = [slot for layer in (*node.wrapping, node.type) for slot, taken in layer.fields.items() if not taken.nodes]
    for slot in (*reversed(node.decorators), *fields):
        if slot in node.modifiers:
            yield f"{slot} {written(node.modifiers[slot][1])}"


def show_text(document: Document, *, width: int = 120) -> str:
    """Return the tree as text, one node a line."""
    lines = [f"{document.main.name}  {document.main.description}".rstrip()]
    root = outline(document)
    if root is not None:
        lines += (text if len(text) <= width else text[: width - 1] + "…" for text in _lines(root, "", ""))
    return "\n".join(lines)


def _lines(branch: DrawnNode, joint: str, below: str) -> Iterator[str]:
    """Yield a node's line, with the joint to its parent, and the lines below it."""
    lead = f"{branch.lead}: " if branch.lead else ""
    details = " · ".join(filter(None, (branch.ports, *branch.modifiers)))
    comment = f"  # {branch.comment}" if branch.comment else ""
    yield f"{joint}{branch.type.symbol} {lead}{branch.name}{f'  {details}' if details else ''}{comment}"
    for child in branch.branches:
        last = child is branch.branches[-1]
        yield from _lines(child, below + ("└─ " if last else "├─ "), below + ("   " if last else "│  "))
