"""A command of Pomona in a process beside a page: python -m pomona.tools.dashboard.side_command COMMAND"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
from collections import deque

from pomona.executive.errors import UsageError

GOODBYE = 5.0
"""Time that a child has to bring a run into its safe state and to end [s]."""

READY = 60.0
"""Time that a command may take to serve its page [s]."""

_LINK = re.compile(r"https?://\S+#token=\S+")


class SideCommand:
    """A command of Pomona in a process of its own, which ends with this one; its last lines are kept."""

    def __init__(self, *words: str) -> None:
        self.lines: deque[str] = deque(maxlen=200)
        self._spoken = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", "pomona.tools.dashboard.side_command", *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, encoding="utf-8", errors="replace", start_new_session=True,
        )  # fmt: skip
        self._thread = threading.Thread(target=self._read, name="pomona-aside", daemon=True)
        self._thread.start()

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return not self._thread.is_alive()

    def link(self) -> str:
        """Wait for the address that it serves. Raises UsageError: it has ended without one, or takes too long."""
        self._spoken.wait(READY)
        found = [link[0] for line in self.lines if (link := _LINK.search(line))]
        if not found:
            raise UsageError(" ".join(self.lines) or "it has not begun to serve")
        return found[0]

    def close(self) -> None:
        """End it and all that it started; harmless after its end."""
        with contextlib.suppress(OSError):
            self._process.stdin.close()  # type: ignore[union-attr]  # a pipe
        self._thread.join(GOODBYE)
        if not self.over:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._thread.join()

    def _read(self) -> None:
        assert self._process.stdout is not None
        assert self._process.stdin is not None
        with self._process.stdout as lines:
            for line in lines:
                self.lines.append(line.rstrip())
                if _LINK.search(line):
                    self._spoken.set()
        self._process.wait()
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._spoken.set()


def _main() -> int:
    """Carry the command out; the end of the input, which the parent holds, ends it as Ctrl-C does."""

    def watch(thread: int) -> None:
        os.read(0, 1)
        signal.pthread_kill(thread, signal.SIGINT)

    threading.Thread(target=watch, args=(threading.main_thread().ident,), daemon=True).start()
    from pomona.executive.cli import main

    return main()


if __name__ == "__main__":
    raise SystemExit(_main())
