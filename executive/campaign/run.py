"""Run a campaign on an engine. Results are lines of a file, so a kill loses no finished run and repeats none."""

from __future__ import annotations

import fcntl
import json
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from executive.campaign.spec import Campaign, CampaignRun
from executive.engine import Engine
from executive.errors import PomonaError, UsageError
from executive.execute import RunOrder, execute
from executive.running.compute import keep_workers_warm
from executive.running.signals import WORDS
from executive.source_commit import commit_here

RESULTS = "results.jsonl"
RUN_LIMIT = 600.0
"""Seconds after which a run's process is killed and the run counted as an error."""

INTERRUPTED = "interrupted"

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


def read_results(folder: Path) -> dict[str, Result]:
    """Finished runs by name. A last line that was cut off by a kill is left out."""
    path = folder / RESULTS
    if not path.is_file():
        return {}
    results = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            result = json.loads(line)
        except ValueError:
            continue
        results[result["name"]] = result
    return results


def finished_runs(campaign: Campaign, folder: Path) -> dict[str, Result]:
    """Results of this campaign's runs, in its order.

    Raises:
        UsageError: the folder holds results of runs of the same name with another tree, cell or setting.
    """
    results = read_results(folder)
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
    engine: Engine,
    progress: Progress = lambda _result, _done, _of: None,
    record: bool = False,
) -> dict[str, Result]:
    """Run what is not done yet.

    Args:
        campaign: planned.
        folder: where results are kept.
        engine: what runs them.
        progress: called with each result, the number done and the number of all.
        record: keep a record of every run, too, in the folder's `records`.

    Returns:
        the results of the campaign's runs by name.

    Raises:
        UsageError: the folder holds results of another campaign, or another process is writing there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _append(folder / RESULTS) as stream:
        done = finished_runs(campaign, folder)
        waiting = [run for run in campaign.runs if run.name not in done]
        records = folder / "records" if record else None
        orders = [(replace(run.order, record=records),) for run in waiting]
        commit = commit_here()
        for index, answer in engine.map(run_order, orders, RUN_LIMIT):
            run = waiting[index]
            result = _result(run, answer, commit)
            if result["outcome"] == INTERRUPTED:
                continue  # somebody ended its process: no result, and no reason not to run it again
            stream.write(json.dumps(result, ensure_ascii=False) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
            done[run.name] = result
            progress(result, len(done), len(campaign.runs))
    return {run.name: done[run.name] for run in campaign.runs if run.name in done}


def _result(run: CampaignRun, answer: Any, commit: str) -> Result:
    about = {"name": run.name, "arm": run.arm, "varied": dict(run.varied), "number": run.number}
    if isinstance(answer, BaseException):
        answer = _broken(getattr(answer, "code", type(answer).__name__), str(answer), "error")
    return {**about, "fingerprint": run.fingerprint, "commit": commit, **answer}


def _broken(code: str, message: str, outcome: str) -> Result:
    return {"outcome": outcome, "reason": {"node": "", "code": code, "message": message, "data": {}}}


@contextmanager
def _append(path: Path) -> Iterator[TextIO]:
    """The file of results, for this process alone; what a kill left of a last line is cut off."""
    with path.open("a+", encoding="utf-8") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(f"{path}: another campaign is writing there") from error
        content = path.read_bytes()
        if content and not content.endswith(b"\n"):
            stream.truncate(content.rfind(b"\n") + 1)
        yield stream


def succeeded(result: Mapping[str, Any], conditions: tuple[str, ...]) -> bool:
    """The tree succeeded and, where there is a simulated world, the world agrees."""
    truth = result.get("truth")
    return result.get("outcome") == "success" and (not truth or all(bool(truth.get(name)) for name in conditions))
