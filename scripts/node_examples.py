"""A small tree for every word of the language: the documentation shows its text and its drawing side by side."""

from __future__ import annotations

import textwrap
from typing import Any

from pomona.executive.language import read
from pomona.executive.nodes import NodeTypes
from pomona.tools.dashboard.drawing import show_svg

TWO = ["MoveTo: {pose: observe}", "Detect: {fruit: apple}"]


def _listed(word: str, *more: str) -> str:
    return "\n".join([f"{word}:", *(f"  - {node}" for node in TWO), *more])


EXAMPLES: dict[str, str] = {
    **{
        word: _listed(word)
        for word in (
            "sequence", "reactive_sequence", "sequence_with_memory", "fallback", "reactive_fallback",
        )
    },
    "parallel": _listed("parallel", "success_on: one"),
    "if": "if: '{mass} > 0.3'\nthen: {MoveTo: {pose: crate}}\nelse: {MoveTo: {pose: home}}",
    "reactive_if": "reactive_if: '{mass} > 0.3'\nthen: {MoveTo: {pose: crate}}\nelse: {MoveTo: {pose: home}}",
    "switch": "switch: '{size}'\ncases:\n  small: {MoveTo: {pose: bin}}\n  large: {MoveTo: {pose: crate}}\n"
    "default: {fail: {code: UNKNOWN_SIZE}}",
    "check": "check: '{found.score} > 0.8'",
    "wait_until": "wait_until: '{door} == open'",
    "wait": "wait: 2 s",
    "set": "set: {slot: '{slot} + 1'}",
    "ask": "ask: Is the crate empty?\nchoices: [yes, no]\nanswer: crate_is_empty",
    "succeed": "succeed: {}",
    "fail": "fail: {code: NO_CRATE, message: no crate stands below the hand}",
    **{
        word: f"MoveTo: {{pose: observe}}\n{word}: {value}"
        for word, value in {
            "speed": "30 %", "timeout": "5 s", "invert": "true", "force": "success", "delay": "2 s", "rate": "5 Hz",
            "repeat": "3", "run_once": "true", "guard": "'{door} == closed'", "when": "'{attempt} > 1'",
            "disabled": "true", "breakpoint": "before", "approve": "true",
        }.items()
    },
    "retry": "Detect: {fruit: apple}\nretry: 3\nretry_if: failure.code == NOTHING_FOUND\n"
    "on_failure: {MoveTo: {pose: observe}}",
    "for_each": "MoveTo: {pose: '{place}'}\nfor_each: '{places}'\nas: place",
}  # fmt: skip
"""Contents of `root:`, by word."""


def document_of(word: str) -> Any:
    """The example of a word as a document that was read."""
    text = f"pomona: 1\ntree: example\nroot:\n{textwrap.indent(EXAMPLES[word], '  ')}\n"
    return read(text, f"{word}.yaml", types=NodeTypes.installed())


def beside(word: str) -> str:
    """The example of a word, and its drawing, as Markdown with HTML."""
    drawn = show_svg(document_of(word)).replace("\n", "")
    return (
        '<div class="example" markdown>\n\n```yaml\n'
        + EXAMPLES[word]
        + f'\n```\n\n<figure tabindex="0">{drawn}</figure>\n\n</div>\n'
    )
