"""Thread-race stress tests: an object that reports use by a second thread, and callers that hammer a device."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from pomona.drivers.errors import DeviceError

PATIENCE = 60.0
"""Nothing here takes long; a loaded machine may let a thread wait [s]."""


class OneThread:
    """Notes which threads use something; `entered` must never be two of them."""

    def __init__(self) -> None:
        self.used_by: set[int] = set()

    def enter(self) -> None:
        self.used_by.add(threading.get_ident())


def hammer(
    calls: dict[str, Callable[[np.random.Generator], object]], rounds: int = 250, threads: int = 4
) -> list[str]:
    """Make random calls from several threads at once; return the errors, except refusals, which are answers.

    Every thread has its own seed; how their calls fall together is the machine's affair.
    """
    wrong: list[str] = []
    together = threading.Barrier(threads)

    def call(seed: int) -> None:
        rng = np.random.default_rng(seed)
        together.wait(PATIENCE)
        for _ in range(rounds):
            name = str(rng.choice(list(calls)))
            try:
                calls[name](rng)
            except DeviceError:
                pass
            except BaseException as error:
                wrong.append(f"{name}: {error!r}")

    callers = [threading.Thread(target=call, args=(seed,)) for seed in range(threads)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(PATIENCE)
        assert not caller.is_alive()
    return wrong
