"""`pomona run --dashboard --wait-for-page` begins when a page is open, so that its viewer misses nothing."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from websockets.sync.client import connect

from pomona.executive.cli import main

TREE = "pomona: 1\ntree: brief\nroot:\n  wait: 10 ms\n"


@pytest.mark.slow
def test_the_run_begins_when_the_page_is_open(tmp_path: Path) -> None:
    (tmp_path / "brief.yaml").write_text(TREE, encoding="utf-8")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    words = [
        "run",
        "brief.yaml",
        "--dry",
        "--no-record",
        "--dashboard",
        "--wait-for-page",
        "--port",
        port,
    ]
    command = [
        sys.executable,
        "-u",
        "-c",
        "import sys; from pomona.executive.cli import main; sys.exit(main())",
    ]
    with (
        subprocess.Popen(
            [*command, *words], stdout=subprocess.PIPE, text=True, cwd=tmp_path
        ) as run,
        ExitStack() as stack,
    ):
        stack.callback(run.kill)  # or a failure would wait for a run that waits for a page
        assert run.stdout is not None
        link = re.search(r"http://(\S+?)/#\S*read=([\w-]+)", run.stdout.readline())
        assert link is not None
        assert run.stdout.readline() == "The run begins when the page is open.\n"
        assert run.poll() is None
        with connect(f"ws://{link[1]}/live?token={link[2]}", max_size=None) as page:
            events = ""
            while '"event":"RunEnded"' not in events.replace(": ", ":"):
                events += str(page.recv(30.0))
        assert '"event":"RunStarted"' in events.replace(": ", ":")
        assert "succeeded" in run.stdout.read()
        assert run.wait(30.0) == 0


def test_without_a_page_there_is_nothing_to_wait_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "brief.yaml").write_text(TREE, encoding="utf-8")
    assert (
        main(["run", str(tmp_path / "brief.yaml"), "--dry", "--no-record", "--wait-for-page"]) == 2
    )
    assert "--wait-for-page needs --dashboard" in capsys.readouterr().err
