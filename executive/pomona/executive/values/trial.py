"""A trial of a file in a process of its own, with limits of processor time and memory.

Libraries that read networks and robots bound neither. In the trial process they read the file first: a file that does
not end, or fills the memory, ends that process and not the run.
"""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

PROCESSOR_S = 4  # limit of a trial; the shipped networks take 0.5 s for loading and one picture [s]
# limit beyond that of the imported libraries; the shipped networks take 0.2 of it [byte]
MEMORY = 512 << 20
WALL_S = 120.0  # on a busy machine; it only ends a process that waits [s]
_NO_MEMORY = (
    "bad_alloc",
    "bad alloc",
    "failed to allocate",
    "allocate memory",
    "memoryerror",
    "out of memory",
)


def trial(
    function: str, *arguments: str, memory: int = MEMORY, processor_s: int = PROCESSOR_S
) -> str:
    """Return the reason why a trial failed, as the rest of a sentence about the file; an empty text if it succeeded.

    Args:
        function: `package.module:name`; called with the arguments it reads the file, and raises an error for a bad one.
        memory: limit beyond that of the function's module and its imports [byte].
        processor_s: limit of processor time after the imports [s].
    """
    command = [
        sys.executable,
        "-P",
        "-m",
        __name__,
        function,
        str(memory),
        str(processor_s),
        *arguments,
    ]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=WALL_S
        )
    except subprocess.TimeoutExpired:
        return f"was not read within {WALL_S:g} s"
    if done.returncode == 0:
        try:
            return str(json.loads(done.stdout.splitlines()[-1]))
        except (ValueError, IndexError):
            return "was not read: the process that tried it gave no answer"
    if done.returncode > 0:
        return f"was not read: the process that tried it ended with status {done.returncode}"
    if -done.returncode in (signal.SIGXCPU, signal.SIGKILL):
        return f"takes more than {processor_s} s of processor time to read and to use once: it is too large or damaged"
    # Without memory a library aborts, or cannot even report it.
    return f"needs more than {memory >> 20} MB of memory, or ends its reader: it is too large or damaged"


def _limit(memory: int, processor_s: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = int(used.ru_utime + used.ru_stime) + processor_s
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sizes = Path("/proc/self/statm")
    if sizes.exists():  # elsewhere the limit is not enforced
        limit = int(sizes.read_text().split()[0]) * resource.getpagesize() + memory
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _causes(error: BaseException | None) -> str:
    texts: list[str] = []
    while error is not None and len(texts) < 10:
        texts.append(f"{type(error).__name__} {error}".lower())
        error = error.__cause__ or error.__context__
    return " ".join(texts)


def main(arguments: Sequence[str]) -> None:
    """Run a trial in this process and print its reason as one line of JSON."""
    function, memory, processor_s, *rest = arguments
    module, _, name = function.partition(":")
    read = getattr(importlib.import_module(module), name)
    _limit(int(memory), int(processor_s))
    reason = ""
    try:
        read(*rest)
    except Exception as error:
        reason = str(getattr(error, "problem", "") or error or type(error).__name__)
        if any(words in _causes(error) for words in _NO_MEMORY):
            reason = f"needs more than {int(memory) >> 20} MB of memory: it is too large or damaged"
    print(json.dumps(reason))


if __name__ == "__main__":
    main(sys.argv[1:])
