"""Permission to begin a run that is being prepared. Another process can withdraw it while this one is busy."""

from __future__ import annotations

import contextlib
import os


class Permit:
    """One byte in a pipe that both processes read: only one of them takes it, and none waits for the other."""

    def __init__(self, read_fd: int, write_fd: int | None = None) -> None:
        """
        Args:
            read_fd: non-blocking end of the pipe.
            write_fd: its other end, in the process that prepares runs.
        """
        self.read_fd, self._write_fd = read_fd, write_fd
        self._closed = False

    @classmethod
    def create(cls) -> Permit:
        """Create the pipe; the other process inherits `read_fd`."""
        read_fd, write_fd = os.pipe()
        os.set_blocking(read_fd, False)
        return cls(read_fd, write_fd)

    def issue(self) -> None:
        """Permit the run whose preparation begins now, and no other."""
        self.take()
        if self._write_fd is not None and not self._closed:
            os.write(self._write_fd, b"1")

    def take(self) -> bool:
        """Return True if the permission was there; it is then used up."""
        if self._closed:
            return False
        with contextlib.suppress(BlockingIOError):
            return bool(os.read(self.read_fd, 16))
        return False

    def close(self) -> None:
        """Close the pipe; nothing can begin any more. Harmless when closed already."""
        if self._closed:
            return
        self._closed = True
        for fd in (self.read_fd, self._write_fd):
            if fd is not None:
                os.close(fd)
