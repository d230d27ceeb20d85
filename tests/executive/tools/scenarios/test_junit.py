"""`pomona test --junit`: results that continuous integration reads."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import pytest

from pomona.executive.cli import main

TREE = "pomona: 1\ntree: t\nskills: {Job: {}}\nroot: {Job: {}, timeout: 2 s}\n"
CASES = """pomona: 1
tree: t.yaml
cases:
  - {name: goes well, mocks: {Job: {after: 500 ms}}}
  - {name: "fails <&> \\u0007", mocks: {Job: {after: 9 s}}}
"""


@pytest.fixture
def scenario(tmp_path):
    (tmp_path / "t.yaml").write_text(TREE)
    path = tmp_path / "t.scenario.yaml"
    path.write_text(CASES)
    return path


def test_each_case_is_written_with_its_time_and_the_reason_of_its_failure(scenario, tmp_path):
    assert main(["test", str(scenario), "--junit", str(tmp_path / "junit.xml")]) == 1
    (suite,) = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("name")) == (
        "2",
        "1",
        str(scenario),
    )
    good, bad = suite
    assert (good.get("name"), list(good)) == ("goes well", [])
    assert float(good.get("time", "")) == pytest.approx(0.5, abs=0.1)
    assert bad.get("name") == "fails <&> \ufffd"
    (failure,) = bad
    assert failure.get("message")
    assert "TIMEOUT" in (failure.text or "")


def test_a_file_that_cannot_be_written_is_named(scenario, tmp_path, capsys):
    assert main(["test", str(scenario), "--junit", str(tmp_path / "no" / "junit.xml")]) == 2
    assert "no/junit.xml: " in capsys.readouterr().err
