"""Each test's coroutine has a loop of its own, whatever test its process has run before."""

from __future__ import annotations

from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ALLOWED = {"executive/loops.py", "executive/test_loops.py"}


def test_no_test_runs_a_loop_in_the_main_thread() -> None:
    found = [
        str(path.relative_to(TESTS))
        for path in sorted(TESTS.rglob("*.py"))
        if "asyncio.run(" in path.read_text("utf-8") or "anyio.run(" in path.read_text("utf-8")
    ]
    assert "executive/loops.py" in found, "the tests were not found"
    assert set(found) <= ALLOWED, (
        "use tests.executive.loops.in_loop: Playwright's loop may run in the main thread"
    )
