"""The door: requests to the operator, marks in records, the log, bounded and confined commands."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.tools.assistants import confined
from pomona.tools.assistants.bounded import STOPPED, BoundedCommands
from pomona.tools.assistants.call_log import CallLog
from pomona.tools.assistants.work_folder import WorkFolder
from pomona.tools.dashboard.approvals import find_request, read_request, version_of
from tests.executive.loops import in_loop
from tests.executive.tools.assistants.conftest import LOOK, Assistant, Refused

pytestmark = pytest.mark.slow


class TestRecords:
    def test_a_run_that_an_assistant_started_holds_this_and_the_number_of_the_call_in_the_log(
        self, assistant: Assistant
    ) -> None:
        assistant.call("list_files")
        record = Path(json.loads(assistant.call("run", tree="look.yaml", seed=4))["record"])
        noted = json.loads((record / "assistant.json").read_text())
        assert noted == {
            "started by": "an assistant (pomona mcp)",
            "call": 2,
            "tree": "look.yaml",
            "cell": "",
            "seed": 4,
            "settings": {},
        }
        logged = [
            json.loads(line)
            for line in (assistant.folder / "runs/assistants.jsonl").read_text().splitlines()
        ]
        assert [(line["call"], line["asked"]["name"], line["refused"]) for line in logged] == [
            (1, "list_files", None),
            (2, "run", None),
        ]

    def test_the_log_goes_on_where_an_earlier_door_has_stopped(self, assistant: Assistant) -> None:
        assistant.call("list_files")
        assert CallLog(assistant.folder / "runs").number() == 2


class TestApprovals:
    def ask(self, assistant: Assistant) -> Path:
        run = Path(json.loads(assistant.call("run", tree="look.yaml"))["record"])
        (run / "assistant.json").unlink()  # as if a person had started it
        text = LOOK.replace("pose: observe", "pose: home")
        assistant.call("write_file", path="look.yaml", text=text, version=version_of(LOOK))
        assistant.call(
            "approve",
            tree="look.yaml",
            cell="bench.yaml",
            reason="home first",
            settings={"tries": "3"},
        )
        return assistant.folder / "runs" / "approvals" / "0001_look"

    def test_a_request_shows_the_operator_reason_difference_and_command(
        self, assistant: Assistant, capsys: pytest.CaptureFixture[str]
    ) -> None:
        request = self.ask(assistant)
        assert main(["mcp", str(assistant.folder), "--requests"]) == 0
        shown = capsys.readouterr().out
        assert "reason: home first" in shown
        assert "-    - MoveTo: {pose: observe}\n+    - MoveTo: {pose: home}\n" in shown
        command = f"pomona run {request}/tree/look.yaml --cell={assistant.folder}/bench.yaml --seed=0 --set=tries=3"
        assert command in shown

    def test_a_request_starts_nothing_and_its_tree_does_not_change_with_the_file(
        self, assistant: Assistant
    ) -> None:
        request = self.ask(assistant)
        assert [words[0] for words in assistant.commands.given] == ["run", "check"]
        (assistant.folder / "look.yaml").write_text("pomona: 1\n")
        assert "pose: home" in (request / "tree" / "look.yaml").read_text()

    def test_a_tree_that_has_never_run_is_shown_whole(self, assistant: Assistant) -> None:
        assistant.call("approve", tree="look.yaml", cell="bench.yaml", reason="first")
        patch = (assistant.folder / "runs/approvals/0001_look/difference.patch").read_text()
        assert all(f"+{line}" in patch for line in LOOK.splitlines())

    def test_a_tree_with_errors_on_the_cell_is_not_asked_for(self, assistant: Assistant) -> None:
        text = LOOK.replace("pose: observe", "pose: nowhere")
        assistant.call("write_file", path="look.yaml", text=text, version=version_of(LOOK))
        with pytest.raises(Refused, match="1 errors on this cell"):
            assistant.call("approve", tree="look.yaml", cell="bench.yaml", reason="x")

    def test_the_operator_removes_a_request(
        self, assistant: Assistant, capsys: pytest.CaptureFixture[str]
    ) -> None:
        request = self.ask(assistant)
        assert main(["mcp", str(assistant.folder), "--dismiss", "0001_look"]) == 0
        assert not request.exists()
        assert main(["mcp", str(assistant.folder), "--dismiss", "../0001_look"]) == 2
        assert main(["mcp", str(assistant.folder), "--requests"]) == 0
        assert "no requests" in capsys.readouterr().out

    def with_a_part(self, assistant: Assistant) -> None:
        main_text = "pomona: 1\ntree: main\nroot: {part: {}}\nsubtrees: {part: {file: look.yaml}}\n"
        (assistant.folder / "main.yaml").write_text(main_text)
        assistant.call("run", tree="main.yaml")
        text = LOOK.replace("pose: observe", "pose: home")
        assistant.call("write_file", path="look.yaml", text=text, version=version_of(LOOK))
        assistant.call("approve", tree="main.yaml", cell="bench.yaml", reason="home first")

    def test_a_request_shows_a_change_in_a_file_that_its_tree_calls(
        self, assistant: Assistant
    ) -> None:
        self.with_a_part(assistant)
        (request,) = (assistant.folder / "runs" / "approvals").iterdir()
        assert "+    - MoveTo: {pose: home}" in (request / "difference.patch").read_text()

    def test_what_an_assistant_ran_by_itself_is_no_reason_to_show_less(
        self, assistant: Assistant
    ) -> None:
        assistant.call("run", tree="look.yaml")
        assistant.call("approve", tree="look.yaml", cell="bench.yaml", reason="first")
        patch = (assistant.folder / "runs/approvals/0001_look/difference.patch").read_text()
        assert all(f"+{line}" in patch for line in LOOK.splitlines())

    def test_a_request_is_another_one_when_its_cell_has_changed(self, assistant: Assistant) -> None:
        request = self.ask(assistant)
        shown = read_request(request)
        cell = assistant.folder / "bench.yaml"
        cell.write_text(cell.read_text() + "heartbeat: 5 s\n")
        with pytest.raises(UsageError, match="has changed"):
            find_request(assistant.folder / "runs", shown.name, shown.version)


class TestFiles:
    def test_a_new_file_never_takes_the_place_of_one_made_meanwhile(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        work, link = WorkFolder(folder, Path("runs")), os.link

        def late(source: str, target: Path) -> None:
            Path(target).write_text("theirs")
            link(source, target)

        monkeypatch.setattr(os, "link", late)
        with pytest.raises(UsageError, match="exists"):
            work.write("new.yaml", LOOK, "", replace=False)
        assert (folder / "new.yaml").read_text() == "theirs"
        assert sorted(path.name for path in folder.glob(".*")) == []

    def test_a_text_is_written_byte_for_byte_and_nothing_is_left_beside_it(
        self, folder: Path
    ) -> None:
        text = "pomona: 1\ntree: t  # größe\r\nroot:\n  wait: 1 s\n"
        WorkFolder(folder, Path("runs")).write("deep/er/t.yaml", text, "", replace=False)
        assert (folder / "deep/er/t.yaml").read_bytes() == text.encode()
        assert [path.name for path in (folder / "deep/er").iterdir()] == ["t.yaml"]

    def test_a_file_that_is_no_yaml_yet_may_be_saved(self, folder: Path) -> None:
        WorkFolder(folder, Path("runs")).write(
            "t.yaml", "pomona: 1\ntree: t\nroot: [\n", "", replace=False
        )
        assert (folder / "t.yaml").exists()

    def test_a_folder_that_does_not_exist_is_refused(self, tmp_path: Path) -> None:
        assert main(["mcp", str(tmp_path / "none")]) == 2


class TestCommands:
    def test_commands_run_one_at_a_time(
        self, assistant: Assistant, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        inside, most = [0], [0]
        proceed = threading.Event()
        one = assistant.commands

        def counted(words, limit):
            inside[0] += 1
            most[0] = max(most[0], inside[0])
            proceed.wait(0.05)
            answer = one(words, limit)
            inside[0] -= 1
            return answer

        monkeypatch.setattr(assistant.door, "_commands", counted)

        async def both() -> None:
            async with Client(assistant.server) as client:
                await asyncio.gather(
                    *(client.call_tool("show", {"tree": "look.yaml"}) for _ in range(4))
                )

        in_loop(both())
        assert most == [1]

    def test_a_command_that_takes_too_long_is_stopped_with_its_children(self, folder: Path) -> None:
        (folder / "forever.yaml").write_text(
            "pomona: 1\ntree: t\nroot:\n  repeat: forever\n  wait: 1 s\n"
        )
        commands = BoundedCommands(folder, folder / "runs")
        answer = commands(["run", "./forever.yaml", "--dry", "--no-record"], 0.2)
        assert answer.status == STOPPED
        assert answer.problem == "stopped after its limit of 0.2 s"

    @pytest.mark.skipif(not confined.version(), reason="this system has no Landlock")
    def test_a_command_writes_and_reads_nothing_outside_its_folders_and_has_no_network(
        self, folder: Path
    ) -> None:
        script = """
import socket, sys
from pathlib import Path
from pomona.tools.assistants.confined import confine
folder = Path(sys.argv[1])
assert confine([folder, *sys.path, "/usr", "/lib", "/lib64"], [folder / "runs"])
def refused(act):
    try:
        act()
    except PermissionError:
        return True
    return False
(folder / "runs" / "mine").write_text("x")
print(
    refused(lambda: (folder / "look.yaml").write_text("x")),
    refused(lambda: (folder.parent / "secret.yaml").read_text()),
    refused(lambda: (folder.parent / "new").mkdir()),
    refused(lambda: socket.create_connection(("127.0.0.1", 9))) or CONNECTS,
    bool((folder / "look.yaml").read_text()),
)
"""
        (folder / "runs").mkdir()
        script = script.replace("CONNECTS", str(confined.version() < 4))
        command = [sys.executable, "-c", script, str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.stdout.split() == ["True"] * 5, done.stderr

    def test_without_this_restriction_no_run_begins(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        script = f"""
import sys
from pomona.tools.assistants import confined
confined.version = lambda: 0
sys.exit(confined.main([{str(tmp_path)!r}, {str(tmp_path)!r}, "run", "pick_apple"]))
"""
        environment = {**os.environ, "TMPDIR": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            env=environment,
            check=False,
        )
        assert done.returncode == 2
        assert "cannot keep a run inside a folder" in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not confined.version(), reason="this system has no Landlock")
def test_an_assistant_writes_runs_and_explains_a_tree_over_standard_input_and_output(
    folder: Path,
) -> None:
    async def session() -> tuple[str, str, str]:
        server = StdioServerParameters(
            command=sys.executable, args=["-m", "pomona.executive.cli", "mcp", str(folder)]
        )
        async with Client(stdio_client(server)) as client:

            async def call(tool: str, **arguments: object) -> str:
                return "".join(
                    part.text for part in (await client.call_tool(tool, arguments)).content
                )

            text = "pomona: 1\ntree: observe\nroot:\n  MoveTo: {pose: observe}\n"
            await call("write_file", path="observe.yaml", text=text)
            checked = await call("check", path="observe.yaml")
            run = await call("run", tree="observe.yaml", seed=3)
            return checked, run, await call("explain")

    checked, run, explained = in_loop(session())
    assert '"errors": 0' in checked
    assert json.loads(run)["cell"] == "sim"
    assert json.loads(run)["outcome"] == "success"
    assert "with seed 3" in explained
