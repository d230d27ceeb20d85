"""Filter for everything written to a terminal: no tree, record or name can control the terminal.

Escape sequences set a window's title, clear the screen, move the cursor or write to the clipboard; right-to-left and
invisible marks make a name look like another one. The filter makes each such character visible: ESC as ␛, a
right-to-left override as <U+202E>. Line breaks and tabs stay.

`filtered_output` filters stdout and stderr of a whole command. A `Screen` (screen.py) filters its input before it adds
colours.
"""

from __future__ import annotations

import contextlib
import json
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, TextIO, cast

HARMFUL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\U000e0000-\U000e007f\ud800-\udfff]"
)
"""Control characters but line break and tab, Unicode's format characters, line separators, halves of characters."""


def visible(text: str) -> str:
    """Return the text with every character that would act instead of being shown replaced by a sign for it."""
    return HARMFUL.sub(_sign, text)


def json_text(value: Any, indent: int | None = None) -> str:
    """Return JSON with such characters escaped, so that a terminal and a program read the same text."""
    return HARMFUL.sub(_escaped, json.dumps(value, ensure_ascii=False, indent=indent))


def write_json(value: Any, indent: int | None = None) -> None:
    """Write a JSON value and a line's end to standard output."""
    sys.stdout.write(json_text(value, indent) + "\n")


def _sign(found: re.Match[str]) -> str:
    code = ord(found[0])
    if code < 0x20:
        return chr(0x2400 + code)
    return "\u2421" if code == 0x7F else f"<U+{code:04X}>"


def _escaped(found: re.Match[str]) -> str:
    return json.dumps(found[0])[1:-1] if found[0] != "\x7f" else "\\u007f"


class Filtered:
    """A stream that filters. It is no terminal, since the colour codes of a library would become visible."""

    def __init__(self, unfiltered: TextIO) -> None:
        self.unfiltered = unfiltered

    def write(self, text: str) -> int:
        """Write a text, filtered."""
        self.unfiltered.write(visible(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts, filtered."""
        for line in lines:
            self.write(line)

    def write_document(self, text: str) -> None:
        """Write a file's text: as it is where that goes into a file or a pipe, filtered in a terminal."""
        self.unfiltered.write(visible(text) if self.unfiltered.isatty() else text)

    def isatty(self) -> bool:
        """Never: see the class."""
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unfiltered, name)


@contextlib.contextmanager
def filtered_output() -> Iterator[None]:
    """Filter standard output and standard error until the end."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast(TextIO, Filtered(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
