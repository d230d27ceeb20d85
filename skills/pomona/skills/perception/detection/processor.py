"""Capabilities of the processor."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

CPU_FLAGS = Path("/proc/cpuinfo")


@lru_cache(maxsize=1)
def has_bfloat16() -> bool:
    """Return True if the processor multiplies matrices of bfloat16 (AMX); others are slower with it than with float32.

    With AVX-512's own bfloat16 and no AMX, finder and eight looks took 48 and 52 ms, in float32 38 and 36 ms.
    """
    if not CPU_FLAGS.is_file():
        return False
    flags = CPU_FLAGS.read_text(encoding="utf-8", errors="replace")
    return "amx_bf16" in flags
