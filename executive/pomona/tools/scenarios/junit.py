"""Results of scenarios as JUnit's XML, which continuous integration shows."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

from pomona.executive.terminal.words import say
from pomona.tools.scenarios.run_scenario import CaseResult, ScenarioResult

_NO_XML = re.compile(
    r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"
)  # signs that XML cannot hold


def junit(results: Iterable[tuple[Path, ScenarioResult]]) -> bytes:
    """Return a document with a suite for each file; `time` is the simulated duration of a case [s]."""
    root = ElementTree.Element("testsuites")
    for path, result in results:
        failed = sum(not case.passed for case in result.cases)
        counts = {
            "tests": str(len(result.cases)),
            "failures": str(failed),
            "errors": "0",
            "skipped": "0",
        }
        duration = sum(case.time for case in result.cases)
        suite = ElementTree.SubElement(
            root, "testsuite", {"name": _text(str(path)), "time": f"{duration:.3f}", **counts}
        )
        for case in result.cases:
            _add(suite, path, case)
    ElementTree.indent(root)
    document: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return document + b"\n"


def _add(suite: ElementTree.Element, path: Path, case: CaseResult) -> None:
    about = {"classname": _text(path.stem), "name": _text(case.case.name), "file": _text(str(path))}
    entry = ElementTree.SubElement(suite, "testcase", {**about, "time": f"{case.time:.3f}"})
    if not case.passed:
        because = [] if case.reason is None else [f"it failed because: {say(case.reason)}"]
        failure = ElementTree.SubElement(entry, "failure", message=_text(case.problems[0]))
        failure.text = _text("\n".join([*case.problems, *because]))


def _text(words: str) -> str:
    return _NO_XML.sub("\ufffd", words)
