"""The one door to many processes: campaigns and the rendering of training frames go through it, here or on a cluster.

    with open_engine("local", workers=2) as engine:
        for index, answer in engine.map(render, [(0,), (1,), (2,)]):
            …

An engine is found by its name among the entry points `pomona.engines`, so another package can add one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import Any, Protocol

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.values.installation import entry_points

GROUP = "pomona.engines"
TRIES = 2  # number of processes that try an order; an order whose processes all die is given up

RENEWED_AFTER = (
    40  # orders of a worker before a fresh one: simulators leave some 25 MB behind each run
)

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "LP_NUM_THREADS",
    ),
    "1",
) | {"OPENCV_FOR_THREADS_NUM": "1"}
"""Environment of a worker. Workers fill the cores; threads inside them would only wait for each other, and sums that
several threads share out depend on how many there are."""


class OrderLost(PomonaError):
    """The process of an order died, in every try."""

    code = "WORKER_DIED"


class OrderTooLong(PomonaError):
    """An order took longer than it may; its process was killed."""

    code = "TIMEOUT"


class Engine(Protocol):
    """Computes one function of many orders, each in a process of its own worker."""

    @property
    def workers(self) -> int:
        """How many orders are computed at once."""

    def map(
        self, function: Callable[..., Any], orders: Sequence[tuple[Any, ...]], limit: float
    ) -> Iterator[tuple[int, Any]]:
        """Compute `function(*order)` of every order.

        Args:
            function: importable by its name; called in another process, perhaps on another machine.
            orders: arguments, all of which can be pickled.
            limit: seconds after which an order is given up.

        Yields:
            the order's index and its result, as they end; in place of a result the exception that it raised,
            OrderLost or OrderTooLong. One order never stops the rest.
        """


def open_engine(
    name: str, workers: int | None = None, address: str | None = None
) -> AbstractContextManager[Engine]:
    """Start an engine; leaving the context ends its processes.

    Args:
        name: local, ray, or an engine of another package.
        workers: processes; None for one per core.
        address: of a cluster; None for this machine.

    Raises UsageError: there is none of that name, or a requirement of it is not installed or not reachable.
    """
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in known:
        raise UsageError(f"there is no engine '{name}'; there are {', '.join(sorted(known))}")
    if workers is not None and workers < 1:
        raise UsageError(f"--workers {workers}: at least one process is needed")
    opened: AbstractContextManager[Engine] = known[name].load()(workers, address)
    return opened


def one_per_core() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def add_engine_options(parser: Any) -> None:
    """`--engine`, `--workers` and `--address` of a subcommand."""
    names = sorted(entry.name for entry in entry_points(group=GROUP))
    parser.add_argument(
        "--engine", default="local", choices=names, help="where processes run (default: local)"
    )
    parser.add_argument(
        "--workers", type=int, default=None, help="processes at once (default: one per core)"
    )
    parser.add_argument(
        "--address", help="of a Ray cluster, HOST:PORT (default: Ray on this machine alone)"
    )
