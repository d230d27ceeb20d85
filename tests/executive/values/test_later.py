"""Modules that take long to import are imported at their first use, or all before a run."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from pomona.executive.values.numba_kernel import kernel

BEFORE_A_RUN = """
import sys
from pomona.executive.registry import Registry
from pomona.executive.values.later import import_all
len(Registry.installed())
slow = ("numba", "cv2", "scipy.ndimage", "scipy.optimize", "scipy.spatial", "scipy.special", "scipy.fft")
print(*[name for name in slow if name in sys.modules])
import_all()
print(*[name for name in slow if name not in sys.modules])
"""


@kernel()
def doubled(x):  # type: ignore[no-untyped-def]
    return 2 * x


@kernel()
def quadrupled(x):  # type: ignore[no-untyped-def]
    return doubled(doubled(x))


def test_all_are_imported_before_a_run_and_none_by_the_skills() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BEFORE_A_RUN], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "\n\n", done.stderr


def test_a_loop_calls_another_one_that_was_not_called_before() -> None:
    assert quadrupled(3) == 12
    assert quadrupled.__name__ == "quadrupled"
    assert len(quadrupled.signatures) == 1
    assert np.allclose(quadrupled(np.arange(3.0)), 4.0 * np.arange(3.0))
