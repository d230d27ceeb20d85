"""A Ray cluster, or Ray's own processes on this machine. Needs `pip install 'pomona[ray]'` here and on every node.

Nodes of a cluster run the installed package and read the same tree and cell files: install the same version at the same
place. Results come back to the process that started, which alone writes files.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import need
from pomona.tools.library.campaign.engine import (
    ONE_THREAD,
    RENEWED_AFTER,
    TRIES,
    Engine,
    OrderLost,
    OrderTooLong,
    one_per_core,
)

LOOK = 1.0  # time limits are looked at this often [s]


@dataclass(slots=True)
class _Running:
    index: int
    tries: int
    ends: float


class RayEngine:
    """Orders as Ray tasks of one core each, as many at once as there are workers."""

    def __init__(self, ray: Any, workers: int) -> None:
        self._ray = ray
        self.workers = workers

    def map(
        self, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]], limit: float
    ) -> Iterator[tuple[int, Any]]:
        """See `Engine.map`."""
        ray, exceptions = self._ray, self._ray.exceptions
        # Retries are counted here, as for local processes: an order that kills its process must come to an end.
        options = {"num_cpus": 1, "max_retries": 0, "max_calls": RENEWED_AFTER}
        task = ray.remote(runtime_env={"env_vars": ONE_THREAD}, **options)(function)
        queue = [(index, 1) for index in reversed(range(len(orders)))]
        busy: dict[Any, _Running] = {}
        try:
            while queue or busy:
                while queue and len(busy) < self.workers:
                    index, tries = queue.pop()
                    busy[task.remote(*orders[index])] = _Running(
                        index, tries, time.monotonic() + limit
                    )
                ended, _ = ray.wait(list(busy), num_returns=1, timeout=LOOK)
                for reference in ended:
                    running = busy.pop(reference)
                    try:
                        answer = ray.get(reference)
                    except exceptions.RayTaskError as error:
                        answer = error.cause
                    except exceptions.RayError as error:  # the process or its node is gone
                        if running.tries < TRIES:
                            queue.append((running.index, running.tries + 1))
                            continue
                        first = str(error).splitlines()[0] if str(error) else type(error).__name__
                        answer = OrderLost(f"its process died {TRIES} times ({first})")
                    yield running.index, answer
                for reference in [
                    r for r, running in busy.items() if running.ends <= time.monotonic()
                ]:
                    ray.cancel(reference, force=True)
                    yield busy.pop(reference).index, OrderTooLong(f"not done within {limit:.0f} s")
        finally:
            for reference in busy:
                ray.cancel(reference, force=True)


@contextmanager
def open_ray(workers: int | None, address: str | None) -> Iterator[Engine]:
    """The engine `ray`. Raises UsageError: Ray is not installed, or cannot be reached."""
    ray = need("ray", "ray", "--engine ray")
    here = {} if address else {"num_cpus": workers or one_per_core(), "include_dashboard": False}
    try:
        ray.init(address=address or "local", log_to_driver=False, logging_level="error", **here)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        raise UsageError(
            f"Ray cannot be reached at {address or 'this machine'}: {error}"
        ) from error
    try:
        yield RayEngine(ray, workers or max(1, int(ray.cluster_resources().get("CPU", 1))))
    finally:
        ray.shutdown()
