"""What the processor can do."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

CPU_FLAGS = Path("/proc/cpuinfo")


@lru_cache(maxsize=1)
def has_bfloat16() -> bool:
    """Whether the processor multiplies bfloat16 natively; elsewhere it would only be slower."""
    if not CPU_FLAGS.is_file():
        return False
    flags = CPU_FLAGS.read_text(encoding="utf-8", errors="replace")
    return "avx512_bf16" in flags or "amx_bf16" in flags
