"""The Model Context Protocol around the door: its tools, and the log of all requests."""

from __future__ import annotations

import functools
import inspect
import re
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from mcp.server import MCPServer
from mcp.server.context import HandlerResult, ServerRequestContext
from mcp.server.mcpserver.exceptions import ToolError
from mcp.shared.exceptions import MCPError
from mcp_types import INTERNAL_ERROR, INVALID_PARAMS, ToolAnnotations

from pomona.executive.errors import PomonaError
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.installation import installed_version
from pomona.tools.assistants.call_log import CallLog
from pomona.tools.assistants.door import Door, call_number

INSTRUCTIONS = (
    "Pomona runs tasks that are written as behaviour trees in YAML. Read an installed tree (list_files, read_file), "
    "find skills and words (skills, words), write a tree (write_file), then check, dry_run, test, run it on a "
    "simulated cell, and explain the run. Answers and help name the next step. A real cell is started by the operator "
    "alone: approve asks."
)
MOST_REFUSAL = 1000  # characters
_DETAIL = re.compile(
    r" \[type=.*?, input_type=\w+\]| For further information visit \S+|^Error executing tool \w+: "
)

Context = ServerRequestContext[Any, Any]
Next = Callable[[Context], Awaitable[HandlerResult]]


class DoorServer(MCPServer[Any]):
    """A server of the door's tools."""

    def __init__(self, door: Door, log: CallLog) -> None:
        super().__init__(
            "pomona",
            version=installed_version(),
            instructions=INSTRUCTIONS,
            log_level="CRITICAL",
            subscriptions=False,
        )
        self._log = log
        for tool in door.tools():
            notes = ToolAnnotations(
                destructive_hint=tool.__name__ == "write_file", open_world_hint=False
            )
            about = (inspect.getdoc(tool) or "").partition("\n\nRaises")[0]
            self.add_tool(
                _refusing(tool), description=about, annotations=notes, structured_output=False
            )
        self.middleware.append(self._logged)

    async def _logged(self, ctx: Context, call_next: Next) -> HandlerResult:
        """Answer a request, and log it before the answer is given."""
        if ctx.method != "tools/call":
            return await call_next(ctx)
        call = self._log.number()
        began = time.monotonic()
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


def _refusing(function: Callable[..., str]) -> Callable[..., str]:
    """Return the function with its anticipated errors as those of the protocol."""

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> str:
        try:
            return function(*arguments, **options)
        except PomonaError as error:
            raise ToolError(_line(str(error))) from None
        except OSError as error:
            raise ToolError(f"{error.strerror or 'the system refuses it'}") from None

    return call


def _refusal(answer: Any) -> str:
    """Return the reason of an answer that is an error, on one line; nothing for any other."""
    if not (isinstance(answer, dict) and answer.get("isError")):
        return ""
    return _line(" ".join(part.get("text", "") for part in answer["content"])) or "refused"


def _line(text: str) -> str:
    line = _DETAIL.sub("", " ".join(text.split()))
    return line if len(line) <= MOST_REFUSAL else f"{line[:MOST_REFUSAL]}…"
