"""A `pomona` command that can neither write outside one folder nor reach a network: python -m … FOLDER WRITABLE WORDS.

The system itself refuses (Landlock, Linux 5.13; TCP from 6.7 on), so the code of a skill is bound by it as well. The
process is killed with the one that started it.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import signal
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from pomona.executive.values.installation import installed_trees

# system calls of Landlock, the same on x86_64 and aarch64 (linux/unistd.h)
_CREATE = 444
_ADD = 445
_RESTRICT = 446
# LANDLOCK_CREATE_RULESET_VERSION, LANDLOCK_RULE_PATH_BENEATH (linux/landlock.h)
_VERSION = 1
_BENEATH = 1
_READ = 0b1101  # execute, read a file, read a folder
_EVERY = (1 << 13) - 1  # all rights of version 1
# from version 2 and 3 on
_REFER = 1 << 13
_TRUNCATE = 1 << 14
# from this version on: bind and connect
_NETWORK = 4
_TCP = 0b11
_FILE_RIGHTS = 0b111 | _TRUNCATE  # those that apply to a file that is no folder
# PR_SET_NO_NEW_PRIVS, PR_SET_PDEATHSIG (linux/prctl.h)
_NO_NEW_PRIVILEGES = 38
_END_WITH_PARENT = 1
MOST_FILE = 4 * 1024**3  # of a file that a command writes [bytes]
_SYSTEM = ("/usr", "/lib", "/lib64", "/bin", "/etc", "/proc", "/sys")
_SHARED = ("/dev", "/dev/shm")


def version() -> int:
    """Return the version of Landlock on this system; 0 without it."""
    if sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64"):
        return 0
    found: int = ctypes.CDLL(None, use_errno=True).syscall(_CREATE, None, 0, _VERSION)
    return max(0, found)


def confine(readable: Iterable[Path | str], writable: Iterable[Path | str]) -> bool:
    """Refuse to this process, and to those that it starts, all other files and TCP; return False if that is impossible.

    Raises OSError: the system refuses the restriction.
    """
    known = version()
    if not known:
        return False
    rights = _EVERY | (_REFER if known >= 2 else 0) | (_TRUNCATE if known >= 3 else 0)
    network = struct.pack("Q", _TCP) if known >= _NETWORK else b""
    rules = _call(_CREATE, struct.pack("Q", rights) + network, 8 + len(network), 0)
    for paths, allowed in ((readable, _READ), (writable, rights)):
        for path in paths:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
                own = allowed if Path(path).is_dir() else allowed & _FILE_RIGHTS
                _call(_ADD, rules, _BENEATH, struct.pack("=Qi", own, handle), 0)
                os.close(handle)
    _prctl(_NO_NEW_PRIVILEGES, 1)
    _call(_RESTRICT, rules, 0)
    os.close(rules)
    return True


def _call(number: int, *arguments: int | bytes) -> int:
    result: int = ctypes.CDLL(None, use_errno=True).syscall(number, *arguments)
    if result < 0:
        raise OSError(ctypes.get_errno(), f"Landlock: {os.strerror(ctypes.get_errno())}")
    return result


def _prctl(option: int, value: int) -> None:
    ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def _packages() -> list[str]:
    """Return the folders of Python and of the installed packages."""
    return [path for path in (*sys.path, sys.prefix, sys.base_prefix) if path]


def _writable(records: str) -> list[str]:
    """Return the folders to write: records, temporary files, compiled code."""
    return [records, os.environ["TMPDIR"], os.environ["XDG_CACHE_HOME"]]


def main(arguments: list[str]) -> int:
    """Carry out the command in the restrictions. Its status is 2 where a run cannot be restricted."""
    folder, writable, *words = arguments
    if sys.platform == "linux":
        _prctl(_END_WITH_PARENT, signal.SIGKILL)
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_FILE, MOST_FILE))
    readable = [folder, str(installed_trees()), *_packages(), *_SYSTEM]
    if not confine(readable, [*_writable(writable), *_SHARED]) and words[:1] == ["run"]:
        sys.stderr.write(
            "this system cannot keep a run inside a folder (that needs Landlock, Linux 5.13 or newer)\n"
        )
        return 2
    from pomona.executive.cli import main as carry_out  # in the restrictions already

    sys.argv = ["pomona", *words]
    return carry_out()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
