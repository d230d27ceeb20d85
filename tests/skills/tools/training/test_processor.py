"""Number formats of the networks, by the processor's features."""

from pathlib import Path

import pytest

from pomona.tools.training import loop

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("fpu avx512f avx512_bf16 amx_bf16 amx_tile", True),
        ("fpu avx512f avx512_bf16", False),
        ("fpu avx2", False),
    ],
)
def test_bfloat16_is_taken_only_where_it_is_faster(
    flags: str, expected: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cpuinfo").write_text(f"processor : 0\nflags : {flags}\n")
    monkeypatch.setattr(loop, "CPU_FLAGS", tmp_path / "cpuinfo")
    assert loop.has_bfloat16.__wrapped__() is expected
    monkeypatch.setattr(loop, "CPU_FLAGS", tmp_path / "none")
    assert loop.has_bfloat16.__wrapped__() is False
