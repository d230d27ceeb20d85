"""A report as a list of blocks, written as Markdown and as one HTML page that needs nothing beside it."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.executive.palette import GOOD, INK, LINE, MUTED


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading below the title; level 2 or 3."""

    text: str
    level: int = 2


@dataclass(frozen=True, slots=True)
class Paragraph:
    """A paragraph; `code` and **bold** are understood. A note is set smaller."""

    text: str
    note: bool = False


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list; of each item `code` and **bold** are understood."""

    items: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """A table; the first column is read as the row's name, the others as figures."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: bool = False
    """Columns hold sentences, not figures: they are set flush left."""


Block = Heading | Paragraph | Bullets | Table


@dataclass(slots=True)
class ReportPage:
    """A title, a line about how the report was made, and blocks."""

    title: str
    about: str
    blocks: list[Block] = field(default_factory=list)

    def add(self, *blocks: Block) -> None:
        """Append blocks to the document."""
        self.blocks.extend(blocks)

    def write(self, folder: Path, name: str = "report") -> tuple[Path, Path]:
        """Write NAME.md and NAME.html.

        Returns:
            both paths.
        """
        folder.mkdir(parents=True, exist_ok=True)
        markdown = folder / f"{name}.md"
        page = folder / f"{name}.html"
        markdown.write_text(to_markdown(self), encoding="utf-8")
        page.write_text(to_html(self), encoding="utf-8")
        return markdown, page


def to_markdown(document: ReportPage) -> str:
    """Return the document as Markdown."""
    parts = [f"# {document.title}", document.about]
    for block in document.blocks:
        match block:
            case Heading(text, level):
                parts.append(f"{'#' * level} {text}")
            case Paragraph(text):
                parts.append(text)
            case Bullets(items):
                parts.append("\n".join(f"- {item}" for item in items))
            case Table():
                parts.append(_markdown_table(block))
    return "\n\n".join(part for part in parts if part) + "\n"


def _markdown_table(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "/").replace("\n", " ") for cell in cells) + " |"

    rule = (
        "|" + "---|" * len(table.header)
        if table.words
        else "|---|" + "--:|" * (len(table.header) - 1)
    )
    lines = [line(table.header), rule, *map(line, table.rows)]
    return (f"*{table.caption}*\n\n" if table.caption else "") + "\n".join(lines)


def to_html(document: ReportPage) -> str:
    """Return the document as one HTML page."""
    body = "\n".join(_html(block) for block in document.blocks)
    return _PAGE.format(
        title=html.escape(document.title), style=_STYLE, about=_inline(document.about), body=body
    )


def _html(block: Block) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{_inline(text)}</h{level}>"
        case Paragraph(text, note):
            return f"<p{' class=note' if note else ''}>{_inline(text)}</p>"
        case Bullets(items):
            return "<ul>" + "".join(f"<li>{_inline(item)}</li>" for item in items) + "</ul>"
        case Table():
            return _html_table(block)


def _html_table(table: Table) -> str:
    def row(cells: Sequence[str]) -> str:
        first, *rest = cells
        return (
            f"<tr><th>{_inline(first)}</th>"
            + "".join(f"<td>{_inline(cell)}</td>" for cell in rest)
            + "</tr>"
        )

    head = "".join(f"<th>{_inline(cell)}</th>" for cell in table.header)
    caption = f"<p class=caption>{_inline(table.caption)}</p>" if table.caption else ""
    kind = ' class="words"' if table.words else ""
    rows = "".join(map(row, table.rows))
    return f'{caption}<div class="wide"><table{kind}><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _inline(text: str) -> str:
    text = html.escape(text, quote=False)
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*([^*]+)\*\*", r"<strong>\1</strong>", text)


_PAGE = """<!doctype html>
<html lang="en-GB">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
<header><h1>{title}</h1><p class="about">{about}</p></header>
{body}
</main>
</body>
</html>
"""

_COLOURS = (
    f":root {{ --ink: {INK}; --soft: {MUTED}; --line: {LINE}; --good: {GOOD}; --paper: #fbfbf8; }}"
)
_STYLE = (
    f"\n{_COLOURS}"
    """
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.55 system-ui, "Segoe UI", sans-serif; }
main { max-width: 70rem; margin: 0 auto; padding: 3rem 1.5rem 5rem; }
header { border-bottom: 3px solid var(--good); margin-bottom: 2rem; padding-bottom: .6rem; }
h1 { font-size: 2.1rem; line-height: 1.2; margin: 0 0 .4rem; letter-spacing: -.01em; }
h2 { font-size: 1.4rem; margin: 3rem 0 .6rem; border-bottom: 1px solid var(--line); padding-bottom: .25rem; }
h3 { font-size: 1.08rem; margin: 2rem 0 .4rem; color: var(--good); }
p, ul { max-width: 50rem; }
.about, .note, .caption { color: var(--soft); font-size: .88rem; }
code { background: #eef1ec; border-radius: 3px; padding: .05em .3em; font-size: .88em; overflow-wrap: anywhere; }
.wide { overflow-x: auto; margin: 0 0 1.4rem; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; background: #fff; }
.caption { margin: 1.6rem 0 .4rem; max-width: none; }
th, td { padding: .34rem .6rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
thead th { border-bottom: 2px solid var(--ink); font-weight: 600; vertical-align: bottom; }
tbody th, thead th:first-child { text-align: left; font-weight: 600; }
tbody tr:hover { background: #f3f7f2; }
table.words th, table.words td { text-align: left; white-space: normal; vertical-align: top; }
table.words td { min-width: 6rem; }
@media print { main { max-width: none; padding: 0; } h2 { break-after: avoid; } table { break-inside: avoid; } }
"""
)
