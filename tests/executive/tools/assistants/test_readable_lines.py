"""Lines of the input that hold no message: each is answered with an error, and the next one is read."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import pytest
from mcp.shared.message import SessionMessage
from mcp_types import JSONRPCError

from pomona.tools.assistants.readable_lines import MOST_LINE, ReadableLines
from tests.executive.loops import in_loop

pytestmark = pytest.mark.slow

GOOD = '{"jsonrpc": "2.0", "id": 1, "method": "tools/list"}\n'
CALL = '{"jsonrpc": "2.0", "id": %s, "method": "tools/call", "params": %s}'

BAD: dict[str, tuple[str, int | str | None, str]] = {
    "a request nested 400 levels": (
        CALL % (2, '{"a": ' + "[" * 400 + "]" * 400 + "}"),
        2,
        "recursion limit",
    ),
    "a request nested 100 000 levels": (
        CALL % (2, '{"a": ' + "[" * 100_000 + "]" * 100_000 + "}"),
        None,
        "recursion",
    ),
    "a line that is too long": ("[" * (3 * MOST_LINE), None, "characters at most"),
    "words": ("list the tools", None, "Invalid JSON"),
    "half a request": (CALL[:40], None, "Invalid JSON"),
    "bytes of another encoding": ("\ufffd\ufffd\0", None, "Invalid JSON"),
    "half a character": (CALL % ('"\\ud800"', "{}"), None, "Invalid JSON"),
    "a list of requests": (f"[{GOOD.strip()}]", None, "an object"),
    "a text": ('"tools/list"', None, "an object"),
    "parameters that are a list": (CALL % ('"seven"', "[1]"), "seven", "params"),
    "a request of another protocol": ('{"id": 9, "method": "tools/list"}', 9, "jsonrpc"),
    "a number that is null": (CALL % ("null", "{}"), None, "id:"),
    "a number that is a truth value": (CALL % ("true", "{}"), None, "id:"),
    "a number with 5000 digits": (CALL % ("9" * 5000, "{}"), None, "out of range"),
}


@dataclass
class Session:
    """Messages that a session receives from some lines, and the errors that are sent at once."""

    read: list[str] = field(default_factory=list)
    sent: list[JSONRPCError] = field(default_factory=list)
    noted: list[tuple[str, str]] = field(default_factory=list)

    async def send(self, item: SessionMessage, /) -> None:
        assert isinstance(item.message, JSONRPCError)
        self.sent.append(item.message)

    def reads(self, text: str) -> None:
        lines = ReadableLines(io.StringIO(text), lambda line, why: self.noted.append((line, why)))
        lines.answer = self.send

        async def read() -> Any:
            self.read = [line async for line in lines]

        in_loop(read())


@pytest.mark.parametrize("name", BAD)
def test_a_line_without_a_message_is_noted_and_answered_and_the_next_one_is_read(name: str) -> None:
    line, number, why = BAD[name]
    session = Session()
    session.reads(f"{line}\n{GOOD}")
    assert session.read == [GOOD]
    (answer,) = session.sent
    assert answer.id == number
    assert why in answer.error.message
    assert "\n" not in answer.error.message
    assert [note for _, note in session.noted] == [answer.error.message]


def test_blank_lines_and_the_end_of_the_input_are_no_requests() -> None:
    session = Session()
    session.reads(f"\n  \n{GOOD.strip()}")
    assert session.read == [GOOD.strip()]
    assert session.sent == []
