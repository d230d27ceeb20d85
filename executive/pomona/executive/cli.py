"""`pomona`: the command line.

Exit status: 0 the task succeeded, 1 the tree failed, 2 unusable input, 3 stopped in the safe state (also by SIGTERM and
SIGHUP), 4 done in part, or unverified, 130 interrupted; 129 and 143 ended by SIGHUP and SIGTERM before anything moved.
"""

from __future__ import annotations

import contextlib
import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Any

try:  # they take a while to load; signals are handled afterwards
    from pomona.executive.commands.command_line import children, make_parser
    from pomona.executive.errors import UsageError
    from pomona.executive.running.launcher import in_child
    from pomona.executive.running.signals import (
        raise_again,
        raising,
        report_end,
        signalled,
        status_of,
    )
    from pomona.executive.terminal.output import filtered_output, unwaiting_output
    from pomona.executive.values.installation import remedy
    from pomona.executive.values.processes import WORDS, within
except (
    KeyboardInterrupt,
    ImportError,
) as error:  # a compiled module turns the first into the second
    if not isinstance(error.__cause__ or error, KeyboardInterrupt):
        raise
    sys.stderr.write("interrupted from the keyboard\n")
    os._exit(130)

PATIENCE = 2.0  # seconds that threads and processes may go on when the work is done
REPORTED = (
    "run",
    "rerun",
)  # commands whose status 0 means that a task succeeded: a process of their own reports it
TICKING = (*REPORTED, "dashboard")  # commands that tick a tree in this process
LEAVING = 5.0  # seconds that the end of such a process takes at most; foreign code may hold a lock that it needs
INTERRUPTED = 128  # a signal ends the process with a status above this


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand."""
    if arguments is not None:
        return _main(list(arguments))
    _complete_streams()
    words = sys.argv[1:]
    return in_child(lambda: _process(words)) if _command(words) in REPORTED else _process(words)


def _complete_streams() -> None:
    """Open closed standard streams, so that no file of the run gets their numbers, and print in any encoding."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the system gives it the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def _process(words: Sequence[str]) -> int:
    """Run one subcommand in a process that is there for it alone."""
    ticking = _command(words) in TICKING
    if _command(words) == "check":
        gc.disable()  # a tenth of its time, and it ends before garbage matters
    try:
        with unwaiting_output() if ticking else contextlib.nullcontext():
            status = _main(words)
            _ignore_signals()
    except KeyboardInterrupt as ended:  # before the signals were handled
        status = _interrupted(ended)
    _end_without(_left(), status, ticking)
    _leave_quietly()
    return status


def _main(words: Sequence[str]) -> int:
    # A notebook names a backend for all its processes that may not be installed here; figures go into files alone.
    os.environ["MPLBACKEND"] = "agg"
    try:
        with raising():
            try:
                return _run(words)
            except Exception:
                raise_again()  # a signal that a foreign module swallowed while it was imported
                raise
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] == "pomona":
            raise
        sys.stderr.write(f"the package {error.name} is not installed; run: {remedy(error.name)}\n")
        return 2
    except BaseException as error:
        if (ended := signalled(error)) is None:
            raise
        return _interrupted(ended)


def _interrupted(ended: KeyboardInterrupt) -> int:
    """Print which signal ended the command, with the notes of those that it interrupted; return the exit status."""
    status = status_of(ended)
    words = WORDS[signal.Signals(status - INTERRUPTED)]
    _print_error(". ".join([words, *getattr(ended, "__notes__", ())]))
    return status


def _command(words: Sequence[str]) -> str:
    """Return the name of the subcommand; empty when there is none."""
    return next(
        (words[index] for index in range(0, len(words), 2) if words[index] != "--skill"), ""
    )


@filtered_output()
def _run(words: Sequence[str]) -> int:
    try:
        parser = make_parser([_command(words)])
        options, unknown = parser.parse_known_args(words)
        if unknown:  # the command's own usage lists its options
            own = next(
                (child for name, _, child in children(parser) if name == _command(words)), parser
            )
            own.error(f"unrecognized arguments: {' '.join(unknown)}")
        status: int = options.main(options)
    except SystemExit as refused:
        if refused.code:
            _print_removed(words)
        raise
    except UsageError as error:
        _print_error(str(error))
        return 2
    except BrokenPipeError:  # `pomona … | head`
        return 1
    except OSError as error:  # for example a missing folder or a full disk: the file and the reason
        if error.filename is None:
            raise
        _print_error(f"{error.filename}: {error.strerror}")
        return 2
    return status


def _print_removed(words: Sequence[str]) -> None:
    """Name the commands and options among refused words that an earlier version had."""
    from pomona.executive.values.removed import removed  # few words are refused

    command = _command(words)
    for word in ("", *words):
        gone = removed("command", f"{command} {word.partition('=')[0]}".strip())
        if gone:
            _print_error(gone)


def _print_error(text: str) -> None:
    from pomona.executive.terminal.screen import Screen

    Screen(stderr=True).print(text, style="red", soft_wrap=True)


def _ignore_signals() -> None:
    """The work is done: a signal must not make a traceback out of the process's end."""
    for number in WORDS:
        signal.signal(number, signal.SIG_IGN)


def _leave_quietly() -> None:
    """A reader that is gone must not make a traceback out of the process's end."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # the remaining output has no reader
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _left() -> list[str]:
    """Return names of the threads and processes for whose end Python would wait before this one ends."""
    threads = [thread.name for thread in threading.enumerate() if not thread.daemon]
    threads.remove(threading.main_thread().name)
    return threads + [child.name for child in _children() if not child.daemon]


def _children() -> list[Any]:
    """Processes of `multiprocessing`, which is loaded where there are some."""
    return (
        sys.modules["multiprocessing"].active_children() if "multiprocessing" in sys.modules else []
    )


def _end_without(left: list[str], status: int, ticking: bool) -> None:
    """End the process after a moment for threads and processes that a skill or a library left; record and cell are
    closed.

    Threads of a pool that only wait for work end by themselves in this time. A command that ticked a tree ends within
    `LEAVING`: a lock of foreign code, such as one of `logging`, may hold up the end of Python.
    """

    def end() -> None:
        threading.Event().wait(PATIENCE)
        if still := _left():
            if (
                status > INTERRUPTED
            ):  # Python cannot stop a thread that computes: who interrupted knows that it went on
                from pomona.executive.running.compute import COMPUTING  # not for every command

                still = [name for name in still if not name.startswith(COMPUTING)]
            with contextlib.suppress(OSError):  # TimeoutError is one
                if still:
                    words = f"still running after the end, and ended with the process: {', '.join(still)}"
                    within(PATIENCE, lambda: _print_error(words))
            for (
                child
            ) in _children():  # Python then does not wait for them; they have been reported before
                child.kill()
        elif ticking:
            threading.Event().wait(LEAVING - PATIENCE)
        else:
            return
        report_end(status)
        os._exit(status)

    if left or ticking:
        threading.Thread(target=end, name="pomona-end", daemon=True).start()


if __name__ == "__main__":
    sys.exit(main())
