"""Formulas of the site as MathML: browsers draw it without a script and without a network."""

from __future__ import annotations

import re
from html import unescape
from typing import Any
from xml.etree import ElementTree

from latex2mathml.converter import convert

FORMULA = re.compile(
    r'<(span|div) class="arithmatex">(?:\\\(|\\\[)(.*?)(?:\\\)|\\\])</\1>', re.DOTALL
)

BRACKETS = re.compile(
    r"<mo[^>]*>&#x0005B;</mo><mtable>(.*?)</mtable><mo[^>]*>&#x0005D;</mo>", re.DOTALL
)
"""A vector or matrix: browsers stretch its brackets only with a mathematical font, so the style sheet draws them."""

BOLD, BOLD_A = re.compile(r'<mi mathvariant="bold">([a-z])</mi>'), 0x1D41A
"""Browsers draw bold letters that are characters of their own, and not the attribute."""


MATHML = "http://www.w3.org/1998/Math/MathML"
PRIME = "\N{PRIME}"


def _with_full_primes(formula: str) -> str:
    """Put primes beside their letter, full size: its sign is raised by itself. Put the variable of min below it."""
    ElementTree.register_namespace("", MATHML)
    root = ElementTree.fromstring(formula)
    for node in list(root.iter()):
        kind, children = node.tag.rpartition("}")[2], list(node)
        if kind in ("msup", "msubsup") and children[-1].text == PRIME:
            base = ElementTree.Element(f"{{{MATHML}}}mrow")
            base.extend(
                [children[0], ElementTree.Element(f"{{{MATHML}}}mo", lspace="0", rspace="0")]
            )
            base[1].text = PRIME
            node.tag = f"{{{MATHML}}}{'mrow' if kind == 'msup' else 'msub'}"
            node[:] = [base, *children[1:-1]]
        elif kind == "msub" and children[0].text == "min":
            node.tag = f"{{{MATHML}}}munder"
    return ElementTree.tostring(root, encoding="unicode")


def on_page_content(html: str, **_others: Any) -> str:
    """A hook of mkdocs: every formula that the arithmatex extension has marked."""

    def drawn(found: re.Match[str]) -> str:
        inline = found[1] == "span"
        formula = str(convert(unescape(found[2]), display="inline" if inline else "block"))
        formula = BRACKETS.sub(r'<mtable class="bracketed">\1</mtable>', formula)
        formula = formula.replace(
            "<mo>&#x0005E;</mo>", '<mo stretchy="false">&#x002C6;</mo>'
        )  # a hat of its own width
        formula = BOLD.sub(
            lambda letter: f"<mi>{chr(BOLD_A + ord(letter[1]) - ord('a'))}</mi>", formula
        )
        formula = _with_full_primes(formula)
        return formula if inline else f'<div class="formula" tabindex="0">{formula}</div>'

    return FORMULA.sub(drawn, html)
