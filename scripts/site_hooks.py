"""Hooks of mkdocs: tables of words come from the code, and whole trees are drawn below their text.

Pages of leaves lie outside the site: a link becomes a repository path.
"""

from __future__ import annotations

import re
from typing import Any

from pomona.executive.language import read
from pomona.executive.nodes import Composite, Leaf, Modifier, NodeTypes
from pomona.tools.dashboard.drawing import show_svg

EMPTY_HEADER = re.compile(r"<th([^>]*)>\s*</th>")
OUTSIDE = re.compile(
    r"\[([^\]]*)\]\((?:\.\./)*((?:executive|drivers|skills)/pomona/[\w./-]*)(?:#[\w-]+)?\)"
)
TABLE_OF_WORDS = re.compile(r"^\{words: (\w+)\}$", re.MULTILINE)
KINDS = {"composites": Composite, "leaves": Leaf, "modifiers": Modifier}
TREE = re.compile(r"^```yaml\n(.*?^root:\n.*?)^```$", re.MULTILINE | re.DOTALL)


def on_page_markdown(markdown: str, **_others: Any) -> str:
    """A hook of mkdocs: paths outside the site; on the page of the language tables of words, and drawn trees."""
    inside = OUTSIDE.sub(_path_outside, markdown)
    if not TABLE_OF_WORDS.search(inside):
        return inside
    return TREE.sub(_drawn, TABLE_OF_WORDS.sub(lambda found: table_of_words(found[1]), inside))


def table_of_words(kind: str) -> str:
    """Return a table with the words of one kind, their fields and their functions."""
    rows = [
        f"| {', '.join(f'`{word}`' for word in (node.key, *node.fields))} | {node.summary} |"
        for node in NodeTypes.installed().values()
        if isinstance(node, KINDS[kind])
    ]
    return "\n".join(["| Word | Function |", "|---|---|", *rows])


def _path_outside(found: re.Match[str]) -> str:
    """Return the path in the repository, below a text of several words also the text."""
    path = f"`{found[2]}`"
    return f"{found[1]} ({path})" if found[1].count(" ") > 1 else path


def on_page_content(html: str, **_others: Any) -> str:
    """A hook of mkdocs: no empty headers of columns."""
    return EMPTY_HEADER.sub(r"<td\1></td>", html)


def on_post_page(output: str, **_others: Any) -> str:
    """A hook of mkdocs: the theme's search dialogue gets a name."""
    search = 'data-md-component="search" role="dialog"'
    return output.replace(search, f'{search} aria-label="Search"')


def on_post_template(output_content: str, **_others: Any) -> str:
    """A hook of mkdocs: the same on the page 404, which is a template."""
    return on_post_page(output_content)


def _drawn(found: re.Match[str]) -> str:
    document = read(found[1], "example.yaml")
    if document.main.main is None or document.main.main.root is None:
        return found[0]
    drawing = show_svg(document).replace("\n", "")
    return f'{found[0]}\n\n<figure tabindex="0">{drawing}</figure>\n'
