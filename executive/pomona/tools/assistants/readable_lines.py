"""Lines of the standard input that hold a message of the protocol; every other line is answered with an error."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TextIO

import anyio.to_thread
from mcp.shared.message import SessionMessage
from mcp_types import (
    INVALID_REQUEST,
    PARSE_ERROR,
    ErrorData,
    JSONRPCError,
    JSONRPCNotification,
    jsonrpc_message_adapter,
)
from pydantic import ValidationError

MOST_LINE = (
    8 * 1024**2
)  # characters: a text that is written has 256 KiB at most, each character up to six in JSON


class ReadableLines:
    """The lines that hold a message, for `stdio_server`, which drops the others without an answer.

    Attributes:
        answer: sends an error; set before the first line is read.
    """

    answer: Callable[[SessionMessage], Awaitable[None]]

    def __init__(self, stream: TextIO, note: Callable[[str, str], None]) -> None:
        """
        Args:
            stream: the standard input.
            note: called with each line that holds no message, and the reason, before the answer.
        """
        self._stream, self._note = stream, note

    async def __aiter__(self) -> AsyncIterator[str]:
        """Yield the lines with a message. A blank line is none, and no request."""
        while line := await self._read():
            error = unreadable(line)
            if error is None and line.strip():
                yield line
            elif error is not None:
                self._note(line, error.error.message)
                await self.answer(SessionMessage(error))

    async def _read(self) -> str:
        """Return the next line, or the beginning of one that is too long; empty at the end of the input."""
        line: str = await anyio.to_thread.run_sync(self._stream.readline, MOST_LINE + 1)
        rest = line
        while len(rest) > MOST_LINE and not rest.endswith("\n"):
            rest = await anyio.to_thread.run_sync(self._stream.readline, MOST_LINE + 1)
        return line


def unreadable(line: str) -> JSONRPCError | None:
    """Return the answer to a line that holds no message; None for a message or a blank line."""
    if not line.strip():
        return None
    if len(line) > MOST_LINE:
        return _error(None, PARSE_ERROR, f"a message has {MOST_LINE} characters at most")
    try:
        message = jsonrpc_message_adapter.validate_json(line, by_name=False)
    except ValidationError as error:
        found = error.errors(include_url=False)[0]
        if found["type"] == "json_invalid":
            return _error(_id_of(line), PARSE_ERROR, found["msg"])
        where = "".join(f"{part}: " for part in found["loc"][1:])
        return _error(
            _id_of(line), INVALID_REQUEST, f"no message of JSON-RPC 2.0: {where}{found['msg']}"
        )
    if isinstance(message, JSONRPCNotification) and "id" in json.loads(line):
        return _error(
            None,
            INVALID_REQUEST,
            "no message of JSON-RPC 2.0: id: neither a whole number nor a text",
        )
    return None


def _error(number: int | str | None, code: int, words: str) -> JSONRPCError:
    return JSONRPCError(jsonrpc="2.0", id=number, error=ErrorData(code=code, message=words))


def _id_of(line: str) -> int | str | None:
    """Return the identifier of a request that cannot be used; None if it has none that can be read."""
    try:
        number = json.loads(line)["id"]
        str(number).encode()
    except (ValueError, RecursionError, TypeError, KeyError, IndexError):
        return None
    return number if isinstance(number, (int, str)) and not isinstance(number, bool) else None
