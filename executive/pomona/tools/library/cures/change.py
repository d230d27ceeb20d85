"""One change of a recorded run: a value of the tree or of the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pomona.executive.execute import RunOrder


@dataclass(frozen=True, slots=True)
class TextPiece:
    """The characters of a file from `start` up to `end`, to replace by a text."""

    start: int
    end: int
    text: str


@dataclass(frozen=True, slots=True)
class SingleChange:
    """One change: settings of the run, or a piece of one tree file.

    Attributes:
        kind: port, parameter, word or option.
        name: of the changed place: `Detect.score`, `attempts`.
        path, line: where it is written.
        before, after: the texts.
        size: how much it changes a value, in factors of two; 1 for a word.
        settings: values of parameters or options.
        piece: of the file `path`; None for a setting.
    """

    kind: str
    name: str
    path: str
    line: int
    before: str
    after: str
    size: float = 1.0
    settings: Mapping[str, str] = field(default_factory=dict)
    piece: TextPiece | None = None

    @property
    def place(self) -> str:
        """`trees/pick_apple.yaml:14`, from the working folder where the file lies below it."""
        path = Path(self.path)
        here = Path.cwd()
        return f"{path.relative_to(here) if path.is_relative_to(here) else path}:{self.line}"

    @property
    def sentence(self) -> str:
        """`trees/pick_apple.yaml:14 Detect.score: 0.99 -> 0.6`."""
        return f"{self.place} {self.name}: {self.before} -> {self.after}"

    def applied(self, order: RunOrder) -> RunOrder:
        """Return the order with this change; the file on the disk stays as it is."""
        texts = dict(order.texts)
        piece = self.piece
        if piece is not None:
            text = texts[self.path]
            texts[self.path] = text[: piece.start] + piece.text + text[piece.end :]
        return replace(order, texts=texts, settings={**order.settings, **self.settings})

    def as_json(self) -> dict[str, Any]:
        """Return the change as JSON."""
        return {
            "kind": self.kind,
            "name": self.name,
            "file": self.path,
            "line": self.line,
            "before": self.before,
            "after": self.after,
        }


def offset(text: str, line: int, column: int) -> int:
    """Return the index of a character, given its line and column from 1."""
    return sum(len(one) for one in text.splitlines(keepends=True)[: line - 1]) + column - 1
