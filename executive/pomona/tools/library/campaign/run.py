"""Run a campaign in worker processes. Results are lines of a file, so a kill loses no finished run and repeats none."""

from __future__ import annotations

import errno
import os
import signal
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any

from pomona.executive.account import disagreement
from pomona.executive.encode import encoded
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.running.compute import keep_workers_warm
from pomona.executive.values.installation import commit_here
from pomona.executive.values.processes import WORDS, lock
from pomona.tools.library.campaign.spec import Campaign, CampaignRun
from pomona.tools.library.pool import WorkerPool

RESULTS = "results.jsonl"
RUN_LIMIT = 600.0  # seconds after which a run's process is killed and the run counted as an error

INTERRUPTED = "interrupted"

FORMAT = 2  # of a line

Result = dict[str, Any]
Progress = Callable[[Result, int, int], None]


def run_order(order: RunOrder) -> Result:
    """Run one order in this process.

    Returns:
        the run's JSON summary, or `{"outcome": "unusable", …}`.
    """
    keep_workers_warm()
    try:
        executed = execute(order)
    except PomonaError as error:
        return _broken(type(error).__name__, str(error), "unusable")
    if executed.signal is not None:
        return _broken("INTERRUPTED", WORDS[signal.Signals(executed.signal)], INTERRUPTED)
    return executed.summary.as_json(executed.record)


def read_results(
    folder: Path, on_problem: Callable[[str], None] = lambda _problem: None
) -> dict[str, Result]:
    """Return finished runs by name, without a last line that a kill cut off.

    Args:
        on_problem: receives a sentence for each invalid or changed line; such runs are repeated.
    """
    path = folder / RESULTS
    if not path.is_file():
        return {}
    results = {}
    lines = path.read_bytes().split(b"\n")
    for number, line in enumerate(lines, start=1):
        if not line.strip() or number == len(lines):  # text behind the last line's end was cut off
            continue
        try:
            result = result_of(line)
        except ValueError as error:
            on_problem(f"{path}:{number}: {error}: it does not count, and its run is made again")
            continue
        results[result["name"]] = result
    return results


def line_of(result: Result) -> bytes:
    """Return a result as one line, with a checksum at its end."""
    text = encoded({"format": FORMAT, **result})[:-1]
    return text + b',"crc32":"%08x"}\n' % zlib.crc32(text)


def result_of(line: bytes) -> Result:
    """Return the result of a line. Raises ValueError: the line does not match its checksum, or has none."""
    result = parse_object(line)
    text, _, crc = line.rstrip().removesuffix(b'"}').rpartition(b',"crc32":"')
    if crc != b"%08x" % zlib.crc32(text):
        raise ValueError("the line does not match its checksum")
    return {key: value for key, value in result.items() if key not in ("format", "crc32")}


def finished_runs(
    campaign: Campaign, folder: Path, on_problem: Callable[[str], None] = lambda _problem: None
) -> dict[str, Result]:
    """Return the results of this campaign's runs in its order; `on_problem` receives the invalid lines.

    Raises UsageError: the folder holds results of runs of the same name with another tree, cell or setting.
    """
    results = read_results(folder, on_problem)
    found = {run.name: results[run.name] for run in campaign.runs if run.name in results}
    for run in campaign.runs:
        if run.name in found and found[run.name].get("fingerprint") != run.fingerprint:
            raise UsageError(
                f"{folder / RESULTS}: '{run.name}' was run with another tree, cell or setting than now. "
                "Name another folder with --out, or delete this one."
            )
    return found


def run_campaign(
    campaign: Campaign,
    folder: Path,
    pool: WorkerPool,
    progress: Progress = lambda _result, _done, _of: None,
    record: bool = False,
) -> dict[str, Result]:
    """Make the runs that have no result yet.

    Args:
        campaign: planned.
        folder: where results are kept.
        pool: runs them.
        progress: called with each result, the number done and the number of all.
        record: also keep a record of each run, in the folder's `records`.

    Returns:
        the results of the campaign's runs by name.

    Raises UsageError: the folder holds results of another campaign, another process writes there, the disk is full, or
    the file of results was removed. Written results stay, and the same command continues.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _append(folder / RESULTS) as stream:
        done = finished_runs(campaign, folder)
        waiting = [run for run in campaign.runs if run.name not in done]
        records = folder / "records" if record else None
        orders = [(replace(run.order, record=records),) for run in waiting]
        commit = commit_here()
        for index, answer in pool.map(run_order, orders, RUN_LIMIT):
            run = waiting[index]
            result = _result(run, answer, commit)
            if result["outcome"] == INTERRUPTED:
                continue  # its process was ended from outside: no result, so the run is repeated
            _write(stream, line_of(result))
            done[run.name] = result
            progress(result, len(done), len(campaign.runs))
    return {run.name: done[run.name] for run in campaign.runs if run.name in done}


def _result(run: CampaignRun, answer: Any, commit: str) -> Result:
    about = {"name": run.name, "arm": run.arm, "varied": dict(run.varied), "number": run.number}
    if isinstance(answer, BaseException):
        answer = _broken(getattr(answer, "code", type(answer).__name__), str(answer), "error")
    return {**about, "fingerprint": run.fingerprint, "commit": commit, **answer}


def _broken(code: str, message: str, outcome: str) -> Result:
    return {
        "outcome": outcome,
        "reason": {"node": "", "code": code, "message": message, "data": {}},
    }


def _write(stream: FileIO, line: bytes) -> None:
    """Append a line to the file of results, which must still be there: another campaign may have begun in its place."""
    try:
        here = os.fstat(stream.fileno())
        there = os.stat(stream.name)
        if (here.st_dev, here.st_ino) != (there.st_dev, there.st_ino):
            raise FileNotFoundError(errno.ENOENT, "the file was removed while the campaign ran")
        if stream.write(line) != len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(stream.fileno())
    except OSError as error:
        raise UsageError(f"{stream.name}: a result cannot be written: {error.strerror}") from error


@contextmanager
def _append(path: Path) -> Iterator[FileIO]:
    """Open the file of results for this process alone; an incomplete last line is removed."""
    with FileIO(path, "a+") as stream:
        try:
            lock(stream)
        except OSError as error:
            raise UsageError(f"{path}: another campaign is writing there") from error
        content = path.read_bytes()
        if content and not content.endswith(b"\n"):
            stream.truncate(content.rfind(b"\n") + 1)
        yield stream


def differs(result: Mapping[str, Any]) -> str:
    """Return how the world's truth contradicts the robot's result of a run: see `disagreement`."""
    return disagreement(result.get("outcome"), result.get("account"), result.get("truth"))


def succeeded(result: Mapping[str, Any]) -> bool:
    """The robot's result is a success and, where there is a simulated world, the world agrees."""
    return result.get("outcome") == "success" and not differs(result)
