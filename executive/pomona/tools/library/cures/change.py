"""One change of a recorded run: a value of the tree or of the cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    """One change: settings of the run, or pieces of one tree file.

    Attributes:
        kind: port, parameter, word or option.
        name: of the changed place: `Detect.score`, `attempts`.
        path, line: where it is written.
        before, after: the texts.
        size: how much it changes a value, in factors of two; 1 for a word.
        settings: values of parameters or options.
        pieces: of the file `path`.
    """

    kind: str
    name: str
    path: str
    line: int
    before: str
    after: str
    size: float = 1.0
    settings: Mapping[str, str] = field(default_factory=dict)
    pieces: tuple[TextPiece, ...] = ()

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
        if self.pieces:
            texts[self.path] = replaced(texts[self.path], self.pieces)
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


def replaced(text: str, pieces: Iterable[TextPiece]) -> str:
    """Return a text with pieces replaced, which do not overlap; all other characters stay."""
    for piece in sorted(pieces, key=lambda piece: -piece.start):
        text = text[: piece.start] + piece.text + text[piece.end :]
    return text


def offset(text: str, line: int, column: int) -> int:
    """Return the index of a character, given its line and column from 1."""
    return sum(len(one) for one in text.splitlines(keepends=True)[: line - 1]) + column - 1
