"""Run a campaign on local processes. Results are lines of a file, so a kill loses no finished run and repeats none."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from executive.campaign.spec import Campaign, CampaignRun
from executive.compute import Worker, WorkerDied
from executive.errors import PomonaError
from executive.execute import RunOrder, execute

RESULTS = "results.jsonl"
RUN_LIMIT = 600.0
"""Seconds after which a run's process is killed and the run counted as an error."""


def run_order(order: RunOrder) -> dict[str, Any]:
    """Run one order in this process.

    Returns:
        the run's JSON summary, or `{"outcome": "unusable", …}`.
    """
    try:
        executed = execute(order)
    except PomonaError as error:
        return {"outcome": "unusable", "reason": {"code": type(error).__name__, "message": str(error)}}
    return executed.summary.as_json(executed.record)


def read_results(folder: Path) -> dict[str, dict[str, Any]]:
    """Finished runs by name. A last line that was cut off by a kill is left out."""
    results: dict[str, dict[str, Any]] = {}
    path = folder / RESULTS
    if not path.is_file():
        return results
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            result = json.loads(line)
        except ValueError:
            continue
        results[result["name"]] = result
    return results


def run_campaign(
    campaign: Campaign,
    folder: Path,
    workers: int,
    progress: Callable[[dict[str, Any], int, int], None] = lambda _result, _done, _of: None,
) -> dict[str, dict[str, Any]]:
    """Run what is not done yet.

    Args:
        campaign: planned.
        folder: where results are kept.
        workers: processes beside this one.
        progress: called with each result, the number done and the number of all.

    Returns:
        all results by name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    results = read_results(folder)
    waiting = [run for run in campaign.runs if run.name not in results]
    with (folder / RESULTS).open("a", encoding="utf-8") as stream:
        for run, outcome in _spread(waiting, workers):
            result = {"name": run.name, "arm": run.arm, "varied": dict(run.varied), **outcome}
            stream.write(json.dumps(result, ensure_ascii=False) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
            results[run.name] = result
            progress(result, len(results), len(campaign.runs))
    return {run.name: results[run.name] for run in campaign.runs if run.name in results}


def _spread(waiting: Sequence[CampaignRun], workers: int) -> Any:
    """Yield (run, outcome) as they end. A process that dies costs its run only."""
    from multiprocessing.connection import wait

    queue = list(reversed(waiting))
    busy: dict[Any, tuple[Worker, CampaignRun]] = {}
    idle: list[Worker] = []
    try:
        while queue or busy:
            while queue and len(busy) < workers:
                worker = idle.pop() if idle else Worker(daemon=False)
                run = queue.pop()
                worker.connection.send((run_order, (run.order,)))
                busy[worker.connection] = (worker, run)
            ready = wait(list(busy), timeout=RUN_LIMIT)
            if not ready:
                for worker, run in busy.values():
                    worker.kill()
                    yield run, _broken("TIMEOUT", f"no run ended within {RUN_LIMIT:.0f} s")
                busy.clear()
            for connection in ready:
                worker, run = busy.pop(connection)
                answered = worker.connection
                try:
                    succeeded, answer = answered.recv()
                except (EOFError, OSError):
                    worker.process.join(5.0)
                    yield run, _broken("WORKER_DIED", str(WorkerDied("run_order", worker.process.exitcode)))
                    continue
                idle.append(worker)
                yield run, answer if succeeded else _broken(type(answer).__name__, str(answer))
    finally:
        for worker in [*idle, *(worker for worker, _run in busy.values())]:
            worker.kill()


def _broken(code: str, message: str) -> dict[str, Any]:
    return {"outcome": "error", "reason": {"node": "", "code": code, "message": message, "data": {}}}
