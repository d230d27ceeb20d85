"""The file that is edited: read whole, watched, and replaced whole when it is saved."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import stat
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.recording.plain_file import replace_file
from pomona.executive.values.plain_text import NotUtf8Error
from pomona.executive.values.yaml_nodes import MAX_CHARACTERS

MOST_BYTES = 4 * MAX_CHARACTERS  # of a file: a character of UTF-8 has four bytes at most
BOM = "\ufeff"


@dataclass(frozen=True, slots=True)
class DiskText:
    """The content of the file.

    Attributes:
        text: lines end with "\\n", without a byte order mark; empty if there is no file.
        stamp: fingerprint of the bytes; empty if there is no file.
        problem: why it cannot be saved, or why it could not be read; empty when all is well.
        readable: whether `text` is the file's.
    """

    text: str = ""
    stamp: str = ""
    problem: str = ""
    readable: bool = True


class SaveRefusedError(PomonaError):
    """A file that is not saved, with the reason."""


class ChangedOnDiskError(SaveRefusedError):
    """A file that another program has changed meanwhile; `disk` is its content."""

    def __init__(self, disk: DiskText) -> None:
        self.disk = disk
        self.facts = {"disk": asdict(disk)}  # for the page
        super().__init__("the file was changed by another program meanwhile: nothing was written")


class EditedFile:
    """One tree file, or the place of a new one."""

    def __init__(self, path: Path) -> None:
        """Raises UsageError: no tree file can stand there."""
        self.given = path
        try:
            self.path = path.resolve()
            link = path.is_symlink()
        except (
            OSError,
            RuntimeError,
            ValueError,
        ) as error:  # a loop of links, a name that cannot be
            raise UsageError(f"{path}: no file can be opened here ({error})") from error
        self.link = str(self.path) if link else ""
        if not self.path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {self.path.parent}; make it first")
        if self.path.exists() and not self.path.is_file():
            raise UsageError(f"{path}: a folder or a device, not a tree file")
        self._seen: tuple[int, ...] = ()
        self._disk = DiskText()
        disk = self.read()
        if not disk.readable:
            raise UsageError(f"{path}: {disk.problem}")

    def read(self) -> DiskText:
        """Return the present content. A file whose size, time and number are the same is not read again."""
        try:
            about = self.path.stat()
        except FileNotFoundError:
            self._seen, self._disk = (), DiskText(problem=self._folder_problem())
            return self._disk
        except OSError as error:
            return DiskText(problem=f"cannot be read: {error.strerror}", readable=False)
        seen = (about.st_mtime_ns, about.st_size, about.st_ino, about.st_mode)
        if seen != self._seen:
            self._disk = self._read(about)
            self._seen = seen
        return self._disk

    def _read(self, about: os.stat_result) -> DiskText:
        if about.st_size > MOST_BYTES:
            megabytes = about.st_size / 1e6
            return DiskText(
                problem=f"has {megabytes:.1f} MB; a tree file has 512 KiB at most", readable=False
            )
        try:
            data = self._bytes()
            written = data.decode("utf-8")
        except UnicodeDecodeError as error:
            return DiskText(
                problem=f"not a text file ({NotUtf8Error(*error.args)})", readable=False
            )
        except OSError as error:
            return DiskText(problem=f"cannot be read: {error.strerror}", readable=False)
        stamp = hashlib.sha256(data).hexdigest()
        text = written.removeprefix(BOM).replace("\r\n", "\n").replace("\r", "\n")
        if len(text) > MAX_CHARACTERS:
            return DiskText(
                problem="is longer than 512 KiB, the most of a tree file", readable=False
            )
        problem = "" if about.st_mode & 0o222 else "the file is read-only"
        if _encoded(text, written) != data:
            problem = "its lines end in different ways: save it with one line ending first"
        return DiskText(text, stamp, problem or self._folder_problem())

    def _bytes(self) -> bytes:
        """Return the content, a little more than the most at most. Raises OSError: no file, or none any more."""
        number = os.open(
            self.path, os.O_RDONLY | os.O_NONBLOCK
        )  # a pipe that took its place does not block
        try:
            if not stat.S_ISREG(os.fstat(number).st_mode):
                raise OSError(errno.EINVAL, "not a file but a folder, a pipe or a device")
            with os.fdopen(number, "rb", closefd=False) as stream:
                return stream.read(MOST_BYTES + 1)
        finally:
            os.close(number)

    def _folder_problem(self) -> str:
        folder = self.path.parent
        if not folder.is_dir():
            return f"the folder {folder} is gone"
        if self.path.is_symlink():  # the path was resolved at the start
            return f"{self.path} has become a link: open it again"
        return "" if os.access(folder, os.W_OK) else f"the folder {folder} is read-only"

    def save(self, text: str, stamp: str) -> DiskText:
        """Replace the file at once by a text; return the new content.

        Args:
            text: lines end with "\\n"; they are written with the line ending that the file has.
            stamp: fingerprint of the content that the text was made from.

        Raises:
            ChangedOnDiskError: the file has another content now.
            SaveRefusedError: it cannot be written.
        """
        with self._alone():
            self._seen = ()
            disk = self.read()
            if disk.stamp != stamp:
                raise ChangedOnDiskError(disk)
            if disk.problem:
                raise SaveRefusedError(f"not saved: {disk.problem}")
            try:
                data = _encoded(text, self._bytes().decode("utf-8") if stamp else "")
                replace_file(self.path, data)
            except OSError as error:
                raise SaveRefusedError(f"not saved: {error.strerror or error}") from error
            return self.read()

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        """Keep other editors of this file waiting: between the look at the content and its replacement."""
        try:
            folder = os.open(self.path.parent, os.O_RDONLY)
        except OSError as error:
            raise SaveRefusedError(f"not saved: {error.strerror}") from error
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield
        except OSError as error:
            if error.errno in (errno.ENOLCK, errno.EOPNOTSUPP):  # a file system without locks
                raise SaveRefusedError("not saved: this file system has no locks") from error
            raise
        finally:
            os.close(folder)


def _encoded(text: str, like: str) -> bytes:
    """Return a text as bytes, with the byte order mark and the line ending of another one."""
    body = like.removeprefix(BOM)
    ending = "\r\n" if "\r\n" in body else "\r" if "\r" in body else "\n"
    return ((BOM if body != like else "") + text.replace("\n", ending)).encode("utf-8")
