"""Thousands of damaged records and messages; `make fuzz` tries a million of each."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from pomona.executive.recording import overview, recorder, scan
from pomona.tools.dashboard import record_messages


@pytest.fixture
def fuzzer(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setattr(
        scan, "open_plain", scan.open_plain
    )  # the fuzzer replaces it by files in memory
    sizes = (
        (overview, "WHOLE"),
        (recorder, "WHOLE_BYTES"),
        (record_messages, "WHOLE"),
        (record_messages, "WHOLE_BYTES"),
    )
    for module, name in sizes:
        monkeypatch.setattr(module, name, getattr(module, name))  # and calls its record a long one
    spec = importlib.util.spec_from_file_location(
        "fuzz_records", Path(__file__).with_name("fuzz_records.py")
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "fuzz_records", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("kind", "cases"), [("records", 2000), ("messages", 5000)])
def test_no_damaged_record_or_message_breaks_a_reader_or_is_believed(
    fuzzer: ModuleType, kind: str, cases: int, tmp_path: Path
) -> None:
    assert list(fuzzer.fuzz(kind, cases, 7, tmp_path)) == []
