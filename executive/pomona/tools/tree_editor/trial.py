"""One dry run, test or simulated run at a time: a child process, and its reports until now."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from typing import IO, Any

from pomona.tools.dashboard.side_command import GOODBYE

MOST_WORDS = 4000
"""Last characters of a child's complaints that are kept."""


class EditorTrial:
    """The child process of the present or last trial. Messages are numbered, so that a page asks for the new ones."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        self._messages: list[dict[str, Any]] = []
        self._number = 0

    def start(self, order: Mapping[str, Any]) -> int:
        """End the last trial, and begin one; return its number."""
        self.close()
        errors = tempfile.TemporaryFile()  # noqa: SIM115  # the reading thread closes it
        process = subprocess.Popen(
            [sys.executable, "-m", "pomona.tools.tree_editor.child"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
            text=True, encoding="utf-8", start_new_session=True,
        )  # fmt: skip
        with self._lock:
            self._number += 1
            self._messages = [{"started": order["kind"]}]
            self._process = process
        self._thread = threading.Thread(
            target=self._read, args=(process, errors), name="pomona-trial", daemon=True
        )
        self._thread.start()
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended: its last words tell why
            process.stdin.write(json.dumps(order) + "\n")
            process.stdin.flush()
        return self._number

    def since(self, number: int, count: int) -> dict[str, Any]:
        """Return the messages of the present trial after the first `count` of trial `number`; all of another one."""
        with self._lock:
            fresh = self._messages[count if number == self._number else 0 :]
            return {"trial": self._number, "count": len(self._messages), "messages": fresh}

    def interrupt(self) -> None:
        """Stop a run in its safe state, as Ctrl-C does. The page of an ended one closes."""
        if self._process is not None and self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGINT)
            self._hang_up(self._process)

    def close(self) -> None:
        """End the child; harmless without one."""
        process = self._process
        thread = self._thread
        if process is None or thread is None:
            return
        self.interrupt()
        try:
            process.wait(GOODBYE)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self._hang_up(process)
        thread.join()
        self._process = None

    @staticmethod
    def _hang_up(process: subprocess.Popen[str]) -> None:
        with contextlib.suppress(OSError):
            if process.stdin is not None:
                process.stdin.close()

    def _read(self, process: subprocess.Popen[str], errors: IO[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout, errors:
            for line in process.stdout:
                with contextlib.suppress(ValueError):
                    self._add(json.loads(line))
            status = process.wait()
            errors.seek(0)
            words = errors.read().decode("utf-8", "replace")[-MOST_WORDS:]
        said = any("problem" in message for message in self._messages)
        problem = (
            "" if said or status in (0, 2) else f"it ended with status {status}: {words.strip()}"
        )
        self._add({"over": True, "problem": problem} if problem else {"over": True})

    def _add(self, message: dict[str, Any]) -> None:
        with self._lock:
            self._messages.append(message)
