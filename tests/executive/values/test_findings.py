"""Findings are listed by how much they matter, then as they are read."""

import pytest

from pomona.executive.values.findings import Finding, Findings


def finding(path: str, line: int, severity: str) -> Finding:
    return Finding(path, line, 1, severity, "code", f"{path} {line}")  # type: ignore[arg-type]


@pytest.mark.parametrize("cell", ["a.yaml", "z.yaml"])
def test_a_note_of_the_cell_never_stands_before_an_error_of_the_tree(cell: str) -> None:
    findings = Findings()
    wanted = [
        finding("m.yaml", 2, "error"),
        finding("m.yaml", 9, "error"),
        finding("m.yaml", 1, "warning"),
        finding(cell, 1, "note"),
    ]
    findings.extend(reversed(wanted))
    assert findings.sorted() == wanted
