"""The Model Context Protocol around the door: tools, records as resources, and the log of all requests."""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import re
import sys
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from mcp.server import MCPServer
from mcp.server.context import HandlerResult, ServerRequestContext
from mcp.server.mcpserver.exceptions import ResourceError, ToolError
from mcp.server.stdio import stdio_server
from mcp.shared.exceptions import MCPError
from mcp_types import INTERNAL_ERROR, INVALID_PARAMS, Resource, ToolAnnotations

from pomona.executive.errors import PomonaError
from pomona.executive.recording.index import RunIndex
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.installation import installed_version
from pomona.tools.assistants.call_log import CallLog
from pomona.tools.assistants.door import PARTS, Door, call_number
from pomona.tools.assistants.readable_lines import ReadableLines

INSTRUCTIONS = (
    "Pomona runs tasks that are written as behaviour trees in YAML. Read an installed tree (list_files, read_file), "
    "find skills and words (skills, words), write a tree (write_file), then check, dry_run, test, run it on a "
    "simulated cell, and explain the run. Answers and help name the next step. A real cell is started by the operator "
    "alone: approve asks."
)
LOGGED = ("tools/call", "resources/read")
MOST_RESOURCES = 100  # newest records in the list of resources
MOST_REFUSAL = 1000  # characters
_DETAIL = re.compile(
    r" \[type=.*?, input_type=\w+\]| For further information visit \S+|^Error executing tool \w+: "
)

Context = ServerRequestContext[Any, Any]
Next = Callable[[Context], Awaitable[HandlerResult]]


class DoorServer(MCPServer[Any]):
    """A server whose resources are the records that exist now."""

    def __init__(self, door: Door, log: CallLog) -> None:
        super().__init__(
            "pomona",
            version=installed_version(),
            instructions=INSTRUCTIONS,
            log_level="CRITICAL",
            subscriptions=False,
        )
        self._door, self._log = door, log
        for tool in door.tools():
            notes = ToolAnnotations(
                destructive_hint=tool.__name__ == "write_file", open_world_hint=False
            )
            about = (inspect.getdoc(tool) or "").partition("\n\nRaises")[0]
            call = _refusing(tool, ToolError)
            self.add_tool(call, description=about, annotations=notes, structured_output=False)
        add = self.resource(
            "pomona://runs/{run}/{part}", name="record", description=f"a record: {', '.join(PARTS)}"
        )
        add(_refusing(door.record_part, ResourceError))
        self.middleware.append(self._logged)

    async def list_resources(self) -> list[Resource]:
        """List the newest records."""
        runs = RunIndex(self._door.folder.records).read()[:MOST_RESOURCES]
        return [
            Resource(
                uri=f"pomona://runs/{run.run}/{part}",
                name=f"{run.run} {part}",
                mime_type="text/plain",
            )
            for run in runs
            for part in PARTS
        ]

    async def run_stdio_async(self) -> None:
        """Serve standard input and output; a line that holds no message is logged, and answered with an error."""
        if isinstance(sys.stdin, io.TextIOWrapper):
            sys.stdin.reconfigure(encoding="utf-8", errors="replace")
        lines = ReadableLines(sys.stdin, self._unreadable)
        async with stdio_server(stdin=lines) as (messages, answers):  # type: ignore[arg-type]  # it only iterates
            lines.answer = answers.send
            options = self._lowlevel_server.create_initialization_options()
            await self._lowlevel_server.run(messages, answers, options)

    def _unreadable(self, line: str, why: str) -> None:
        with contextlib.suppress(OSError):  # the answer is an error in any case
            self._log.write(self._log.number(), "unreadable", {"line": line}, why, 0.0)

    async def _logged(self, ctx: Context, call_next: Next) -> HandlerResult:
        """Answer a request, and log it before the answer is given."""
        if ctx.method not in LOGGED:
            return await call_next(ctx)
        call, began = self._log.number(), time.monotonic()
        call_number.set(call)
        asked = {key: value for key, value in (ctx.params or {}).items() if key != "_meta"}
        answer, refusal = await self._answered(ctx, call_next, asked)
        refused = _line(str(refusal)) if refusal is not None else _refusal(answer)
        try:
            self._log.write(call, ctx.method, asked, refused, time.monotonic() - began)
        except OSError as error:
            raise MCPError(
                code=INTERNAL_ERROR,
                message=f"{self._log.path}: {error.strerror}: no log, no answer",
            ) from None
        if refusal is not None:
            raise MCPError(code=INVALID_PARAMS, message=refused)
        return answer if not refused else {**answer, "content": [{"type": "text", "text": refused}]}

    async def _answered(
        self, context: Context, follow: Next, asked: Mapping[str, Any]
    ) -> tuple[Any, Exception | None]:
        arguments = asked.get("arguments") or {}
        tool = next(
            (tool for tool in await self.list_tools() if tool.name == asked.get("name")), None
        )
        known = tool.input_schema["properties"] if tool is not None else {}
        for name in arguments if tool is not None and isinstance(arguments, dict) else ():
            if name not in known:
                hint = did_you_mean(str(name), known) or f"it has {', '.join(known) or 'none'}"
                return None, MCPError(
                    INVALID_PARAMS,
                    f"{asked['name']} has no argument '{_line(str(name))[:60]}'; {hint}",
                )
        try:
            return await follow(context), None
        except Exception as error:  # the log holds it before the client does
            return None, error


def _refusing(function: Callable[..., str], kind: type[Exception]) -> Callable[..., str]:
    """Return the function with its anticipated errors as those of the protocol."""

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> str:
        try:
            return function(*arguments, **options)
        except PomonaError as error:
            raise kind(_line(str(error))) from None
        except OSError as error:
            raise kind(f"{error.strerror or 'the system refuses it'}") from None

    return call


def _refusal(answer: Any) -> str:
    """Return the reason of an answer that is an error, on one line; nothing for any other."""
    if not (isinstance(answer, dict) and answer.get("isError")):
        return ""
    return _line(" ".join(part.get("text", "") for part in answer["content"])) or "refused"


def _line(text: str) -> str:
    line = _DETAIL.sub("", " ".join(text.split()))
    return line if len(line) <= MOST_REFUSAL else f"{line[:MOST_REFUSAL]}…"
