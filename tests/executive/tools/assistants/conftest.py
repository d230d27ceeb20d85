"""A folder for an assistant, and a door whose commands run in this process, simulated runs without a cell."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pomona.executive.cli import main
from pomona.tools.assistants.bounded import Answer
from pomona.tools.assistants.call_log import CallLog
from pomona.tools.assistants.door import Door
from pomona.tools.assistants.work_folder import WorkFolder
from tests.executive.loops import in_loop

if TYPE_CHECKING:  # the protocol takes two seconds to load, and quick tests need none of it
    from mcp import Client

    from pomona.tools.assistants.server import DoorServer

LOOK = """\
pomona: 1
tree: look
parameters:
  tries: {type: int, default: 2}
root:
  sequence:
    - MoveTo: {pose: observe}
    - Detect: {fruit: apple, detection: "{seen}"}
      retry: "{tries}"
"""

SCENARIO = """\
pomona: 1
tree: look.yaml
cases:
  - name: no fruit is seen
    mocks: {Detect: [NOTHING_FOUND, NOTHING_FOUND]}
    expect: {status: failure, code: NOTHING_FOUND}
"""

BENCH = """\
name: bench
kind: real
workspace: {include: shared/workspace.yaml}
world: {driver: mock}
devices:
  arm: {driver: mock-arm}
  gripper: {driver: mock-gripper}
  fingers: {driver: mock-fingers}
  camera: {driver: mock-camera}
"""


@dataclass
class Refused(Exception):
    """A request that the door has refused, in words."""

    words: str

    def __str__(self) -> str:
        return self.words


@dataclass
class HereCommands:
    """`pomona` commands in this process. A run on a cell is one without: the door is under test, not the cell."""

    folder: Path
    given: list[list[str]] = field(default_factory=list)

    def __call__(self, words: Sequence[str], limit: float) -> Answer:
        self.given.append(list(words))
        words = list(words)
        if words[0] == "run" and "--simulated" in words:
            words = [
                "--dry" if word == "--simulated" else word
                for word in words
                if not word.startswith("--cell=")
            ]
        out, err = io.StringIO(), io.StringIO()
        with (
            contextlib.chdir(self.folder),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            try:
                status = main(words)
            except SystemExit as ended:
                status = int(ended.code or 0)
        return Answer(status, out.getvalue(), err.getvalue())


@dataclass
class Assistant:
    """A client of the door, one session for each request."""

    folder: Path
    door: Door
    server: DoorServer
    commands: HereCommands

    def call(self, tool: str, **arguments: Any) -> str:
        """Return the text of a tool's answer. Raises Refused."""

        async def ask(client: Client) -> str:
            answer = await client.call_tool(tool, arguments)
            text = "".join(part.text for part in answer.content)
            if answer.is_error:
                raise Refused(text)
            return text

        return self._ask(ask)

    def listed(self) -> list[str]:
        """Return the names of the tools."""

        async def ask(client: Client) -> list[str]:
            return [tool.name for tool in (await client.list_tools()).tools]

        return self._ask(ask)

    def _ask(self, ask: Callable[[Client], Any]) -> Any:
        from mcp import Client
        from mcp.shared.exceptions import MCPError

        async def session() -> Any:
            async with Client(self.server) as client:
                try:
                    return await ask(client)
                except MCPError as error:
                    return Refused(str(error))
                except Refused as refused:
                    return refused

        result = in_loop(session())
        if isinstance(result, Refused):
            raise result
        return result


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "work"
    place.mkdir()
    (place / "look.yaml").write_text(LOOK)
    (place / "look_scenario.yaml").write_text(SCENARIO)
    (place / "bench.yaml").write_text(BENCH)
    (tmp_path / "secret.yaml").write_text(LOOK.replace("look", "secret"))
    (place / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    (place / "up").symlink_to(tmp_path)
    return place


@pytest.fixture
def assistant(folder: Path) -> Assistant:
    from pomona.tools.assistants.server import DoorServer

    work = WorkFolder(folder, Path("runs"))
    commands = HereCommands(folder)
    door = Door(work, commands, most_runs=3)
    return Assistant(folder, door, DoorServer(door, CallLog(work.records)), commands)
