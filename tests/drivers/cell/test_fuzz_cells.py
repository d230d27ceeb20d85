"""A damaged cell file gives findings, never a traceback; `make fuzz` tries many more."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Findings

SPEC = importlib.util.spec_from_file_location(
    "fuzz_cells", Path(__file__).with_name("fuzz_cells.py")
)
assert SPEC is not None
assert SPEC.loader is not None
fuzzer = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(fuzzer)


def test_mutated_cells() -> None:
    assert fuzzer.fuzz(40, 1) == []


def test_the_fuzzer_judges_the_damaged_text_and_not_the_file() -> None:
    path = next(path for path in fuzzer.shipped_cells() if path.name == "sim.yaml")
    findings = Findings()
    assert judge_cell_file(path, findings, {}, {str(path): "name: x\nnonsense: [\n"}) is None
    assert findings.sorted()
