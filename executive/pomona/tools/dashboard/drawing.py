"""A tree in words and as an SVG picture: the root on the left, its branches to the right in the order of execution."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from xml.sax.saxutils import escape

from pomona.executive.language.model import Document, TreeNode
from pomona.executive.nodes.leaves import SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.yaml_nodes import written


@dataclass(frozen=True, slots=True)
class DrawnNode:
    """A node and the nodes below it."""

    type: NodeType  # the node's
    name: str  # its own name with its type, or its type
    ports: str  # its ports or its value, as written
    modifiers: tuple[
        str, ...
    ]  # from the outside to the inside, then the node's other fields, as written
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
        below = [
            (child, lead.removesuffix(": "), calls)
            for child, lead in zip(node.children, node.leads, strict=True)
        ]
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
    if not (node.type.value.nodes or node.type.value.wires) and written(node.value) not in (
        "",
        "{}",
    ):
        return written(node.value)
    return ""


def _modifiers(node: TreeNode) -> Iterator[str]:
    fields = [
        slot
        for layer in (*node.wrapping, node.type)
        for slot, taken in layer.fields.items()
        if not taken.nodes
    ]
    for slot in (*reversed(node.decorators), *fields):
        if slot in node.modifiers:
            yield f"{slot} {written(node.modifiers[slot][1])}"


def show_text(document: Document, *, width: int = 120) -> str:
    """Return the tree as text, one node a line."""
    lines = [f"{document.main.name}  {document.main.description}".rstrip()]
    root = outline(document)
    if root is not None:
        lines += (
            text if len(text) <= width else text[: width - 1] + "…"
            for text in _indented(root, "", "")
        )
    return "\n".join(lines)


def _indented(branch: DrawnNode, joint: str, below: str) -> Iterator[str]:
    """Yield a node's line, with the joint to its parent, and the lines below it."""
    lead = f"{branch.lead}: " if branch.lead else ""
    details = " · ".join(filter(None, (branch.ports, *branch.modifiers)))
    comment = f"  # {branch.comment}" if branch.comment else ""
    yield f"{joint}{branch.type.symbol} {lead}{branch.name}{f'  {details}' if details else ''}{comment}"
    for child in branch.branches:
        last = child is branch.branches[-1]
        yield from _indented(
            child, below + ("└─ " if last else "├─ "), below + ("   " if last else "│  ")
        )


# font sizes of names, and of ports and modifiers [px]
NAME = 13.0
SMALL = 10.5
# characters that are drawn; the rest is in the node's title
MOST_NAME = 34
MOST_PORTS = 46
MOST_MODIFIER = 30
# inside a box, between two branches, and between a box and its children [px]
PADDING = 10.0
GAP = 10.0
STEP = 36.0
# heights of a box with a name, of its line of ports, and of a modifier [px]
LINE = 26.0
PORTS_LINE = 14.0
PILL = 16.0
MARGIN = 12.0
INK, MUTED, RULE = "#1a1e23", "#5b6470", "#8b95a1"


@dataclass(slots=True, eq=False)
class _Box:
    """A node in the picture: its left edge, its centre line, its size, and the children's boxes."""

    branch: DrawnNode
    x: float
    children: list[_Box]
    y: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.branch.type.symbol} {_cut(self.branch.name, MOST_NAME)}"

    @property
    def ports(self) -> str:
        return _cut(self.branch.ports, MOST_PORTS)

    @property
    def pills(self) -> list[str]:
        return [_cut(words, MOST_MODIFIER) for words in self.branch.modifiers]

    @property
    def width(self) -> float:
        pills = sum(_width(words, SMALL) + PADDING for words in self.pills) + 4.0 * len(self.pills)
        return max(
            _width(self.name, NAME) + 2 * PADDING, _width(self.ports, SMALL) + 2 * PADDING, pills
        )

    @property
    def height(self) -> float:
        return LINE + (PORTS_LINE if self.branch.ports else 0.0)

    @property
    def above(self) -> float:
        return self.height / 2 + (PILL + 3.0 if self.branch.modifiers else 0.0)


def show_svg(document: Document) -> str:
    """Return the tree as an SVG picture without scripts, styles from outside or links."""
    title = escape(document.main.name)
    root = outline(document)
    box = None if root is None else _boxes(root, MARGIN)
    high = MARGIN + (MARGIN if box is None else _place(box, MARGIN))
    wide = MARGIN + max(320.0, 0.0 if box is None else _right(box))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.0f}" height="{high:.0f}"'
        f' viewBox="0 0 {wide:.0f} {high:.0f}"'
        """ font-family="system-ui, 'DejaVu Sans', sans-serif" role="img">""",
        f"<title>{title}</title>",
        '<rect width="100%" height="100%" fill="#ffffff"/>',
        *([] if box is None else [*_lines(box), *_drawn(box)]),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _boxes(branch: DrawnNode, x: float) -> _Box:
    box = _Box(branch, x, [])
    inset = STEP + max((_width(child.lead, SMALL) for child in branch.branches), default=0.0)
    box.children = [_boxes(child, x + box.width + inset) for child in branch.branches]
    return box


def _place(box: _Box, top: float) -> float:
    """Place a box and everything below it, from this height on; return the lower end."""
    if not box.children:
        box.y = top + box.above
        return box.y + box.height / 2
    bottom = top
    for child in box.children:
        bottom = _place(child, bottom if child is box.children[0] else bottom + GAP)
    box.y = max((box.children[0].y + box.children[-1].y) / 2, top + box.above)
    return max(bottom, box.y + box.height / 2)


def _right(box: _Box) -> float:
    return max([box.x + box.width, *map(_right, box.children)])


def _lines(box: _Box) -> Iterator[str]:
    """From each box to its children."""
    x = box.x + box.width
    y = box.y
    for child in box.children:
        dash = ' stroke-dasharray="4 3"' if child.branch.lead.startswith("on ") else ""
        bend = f"{x + 20:.1f} {y:.1f} {x + 12:.1f} {child.y:.1f} {x + STEP - 8:.1f} {child.y:.1f}"
        yield f'<path d="M{x:.1f} {y:.1f}C{bend}H{child.x:.1f}" fill="none" stroke="{RULE}"{dash}/>'
        if child.branch.lead:
            yield _text(
                child.x - 6, child.y - 4, child.branch.lead, SMALL, MUTED, ' text-anchor="end"'
            )
        yield from _lines(child)


def _drawn(box: _Box) -> Iterator[str]:
    branch = box.branch
    colour = box.branch.type.colour
    top = box.y - box.height / 2
    leaf = not branch.branches
    about = "\n".join(filter(None, (branch.name, branch.ports, *branch.modifiers, branch.comment)))
    yield f"<g><title>{escape(about)}</title>"
    at = box.x
    for words in box.pills:
        wide = _width(words, SMALL) + PADDING
        yield _rectangle(at, top - PILL - 3, wide, PILL, f'rx="8" fill="#ffffff" stroke="{RULE}"')
        yield _text(at + wide / 2, top - 6.5, words, SMALL, MUTED, ' text-anchor="middle"')
        at += wide + 4.0
    corner = 4 if leaf else 12
    shape = (box.x, top, box.width, box.height)
    yield _rectangle(*shape, f'rx="{corner}" fill="#ffffff"')
    yield _rectangle(*shape, f'rx="{corner}" fill="{colour}" fill-opacity="0.07" stroke="{colour}"')
    bold = ' font-weight="600"' if leaf else ""
    yield _text(box.x + PADDING, top + 17.5, box.name, NAME, colour if leaf else INK, bold)
    if branch.ports:
        yield _text(box.x + PADDING, top + LINE + 6.5, box.ports, SMALL, MUTED)
    yield "</g>"
    for child in box.children:
        yield from _drawn(child)


def _rectangle(x: float, y: float, width: float, height: float, look: str) -> str:
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" {look}/>'


def _text(x: float, y: float, words: str, size: float, colour: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}"{more}>{escape(words)}</text>'


def _cut(words: str, most: int) -> str:
    return words if len(words) <= most else words[: most - 1].rstrip(" ,") + "…"


def _width(words: str, size: float) -> float:
    return (
        0.58 * size * len(words)
    )  # mean width of a character over the font's size; DejaVu Sans, a wide one, has 0.57
