"""Formulas of the site as MathML: browsers draw it without a script and without a network."""

from __future__ import annotations

import re
from html import unescape
from typing import Any

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">(?:\\\(|\\\[)(.*?)(?:\\\)|\\\])</\1>', re.DOTALL)


def on_page_content(html: str, **_others: Any) -> str:
    """A hook of mkdocs: every formula that the arithmatex extension has marked."""

    def drawn(found: re.Match[str]) -> str:
        return str(convert(unescape(found[2]), display="inline" if found[1] == "span" else "block"))

    return FORMULA.sub(drawn, html)
