"""Draw a tree: as text for the terminal, as SVG for a page. Both escape what they show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

from pomona.executive.language.model import Document, TreeNode
from pomona.executive.nodes.calls import SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.written import written


@dataclass(frozen=True, slots=True)
class Drawn:
    """One line of a drawing. `rails` says for each level above whether its line goes on below this one."""

    depth: int
    type: NodeType
    name: str
    detail: str
    comment: str
    rails: tuple[bool, ...]
    last: bool


def draw(document: Document) -> list[Drawn]:
    """All lines of a drawing, in order.

    Args:
        document: from `read`; parts that could not be read are left out.
        subtrees: draw called subtrees in their place.
    """
    main = document.main.main
    if main is None or main.root is None:
        return []
    lines: list[Drawn] = []
    _Drawing(document, lines).node(main.root, (), True, ())
    return lines


@dataclass(slots=True, eq=False)
class _Drawing:
    document: Document
    lines: list[Drawn]

    def node(self, node: TreeNode, rails: tuple[bool, ...], last: bool, calls: tuple[str, ...], lead: str = "") -> None:
        below = [(child, lead, calls) for child, lead in zip(node.children, node.leads, strict=True)]
        called = self.called(node)
        if called is not None and node.key.text not in calls and len(self.lines) < 20_000:
            below.append((called, "", (*calls, node.key.text)))
        below += [(part, f"{slot.replace('_', ' ')}: ", calls) for slot, part in node.parts.items()]
        detail = " · ".join(_details(node))
        named = node.name.text if node.name is not None else ""
        name = node.key.text if not named else f"{named} ({node.key.text})"
        comment = node.description or node.comment
        self.lines.append(Drawn(len(rails), node.type, lead + name, detail, comment, rails, last))
        for index, (child, child_lead, child_calls) in enumerate(below):
            self.node(child, (*rails, not last), index == len(below) - 1, child_calls, child_lead)

    def called(self, node: TreeNode) -> TreeNode | None:
        definition = self.document.called(node) if node.type is SUBTREE else None
        return None if definition is None else definition.root


def _details(node: TreeNode) -> Iterator[str]:
    """Its ports or its value, then its modifiers from the outside to the inside, then all fields."""
    if node.ports:
        yield ", ".join(f"{name}: {written(value)}" for name, (_, value) in node.ports.items())
    elif not (node.type.value.nodes or node.type.value.wires) and written(node.value) not in ("", "{}"):
        yield written(node.value)
    fields = [slot for layer in (*node.wrapping, node.type) for slot, taken in layer.fields.items() if not taken.nodes]
    for slot in (*reversed(node.decorators), *fields):
        if slot in node.modifiers:
            yield f"{slot} {written(node.modifiers[slot][1])}"


def show_text(document: Document, *, width: int = 120) -> str:
    """The tree as text, one node a line."""
    lines = [f"{document.main.name}  {document.main.description}".rstrip()]
    for line in draw(document):
        rails = "".join("│  " if rail else "   " for rail in line.rails[1:])
        joint = "" if line.depth == 0 else ("└─ " if line.last else "├─ ")
        text = f"{rails}{joint}{line.type.symbol} {line.name}"
        if line.detail:
            text += f"  {line.detail}"
        if line.comment:
            text += f"  # {line.comment}"
        lines.append(text if len(text) <= width else text[: width - 1] + "…")
    return "\n".join(lines)


_ROW, _INDENT, _TEXT = 26, 22, 13


def show_svg(document: Document) -> str:
    """The tree as an SVG picture without scripts, styles from outside or links."""
    lines = draw(document)
    widest = max((_width(line) for line in lines), default=0)
    width, height = max(320, widest + 40), _ROW * (len(lines) + 1) + 20
    title = escape(document.main.name)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        f' font-family="system-ui, sans-serif" font-size="{_TEXT}" role="img">',
        f"<title>{title}</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="16" y="24" font-weight="bold">{title}</text>',
        *_joints(lines),
    ]
    for row, line in enumerate(lines):
        x, y = 24 + _INDENT * line.depth, 40 + _ROW * row + _ROW // 2
        colour = line.type.colour
        symbol, name = escape(line.type.symbol), escape(line.name)
        parts.append(f'<text x="{x}" y="{y}" fill="{colour}" text-anchor="middle">{symbol}</text>')
        detail = f'  <tspan fill="#666666">{escape(line.detail)}</tspan>' if line.detail else ""
        parts.append(f'<text x="{x + 14}" y="{y}"><tspan fill="{colour}">{name}</tspan>{detail}</text>')
        if line.comment:
            parts.append(f"<!-- {escape(line.comment).replace('--', '- -')} -->")
    return "\n".join([*parts, "</svg>"]) + "\n"


def _width(line: Drawn) -> int:
    return 24 + _INDENT * line.depth + 20 + int(_TEXT * 0.62 * (len(line.name) + len(line.detail) + 3))


def _joints(lines: Sequence[Drawn]) -> list[str]:
    """Lines from each node down to its children."""
    parts = []
    parents: dict[int, int] = {}
    for row, line in enumerate(lines):
        parents[line.depth] = row
        if line.depth == 0:
            continue
        x = 24 + _INDENT * (line.depth - 1)
        above = 40 + _ROW * parents[line.depth - 1] + _ROW // 2 + 5
        y = 40 + _ROW * row + _ROW // 2 - 4
        parts.append(f'<path d="M{x} {above}V{y}H{x + _INDENT - 8}" fill="none" stroke="#bbbbbb"/>')
    return parts
