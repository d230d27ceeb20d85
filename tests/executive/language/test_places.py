"""A finding points at the key or the value that is wrong, however deep it stands; too many are not written out."""

from __future__ import annotations

import os

import pytest

from pomona.executive.errors import UsageError
from pomona.executive.files import find_tree, read_text
from pomona.executive.language import read
from pomona.executive.values.findings import MAX_SHOWN, Findings, did_you_mean, format_findings
from pomona.executive.values.yaml_nodes import YamlScalar

HEAD = "pomona: 1\ntree: t\n"


@pytest.mark.parametrize(
    "marked",
    [
        "root: {sequence: [{fallback: [{MoveTo: {pose: a, variation: »x}}]}]}",
        "root: {sequence: [{fallback: [{MoveTo: {pose: a, »speed: 3}}]}]}",
        "root: {sequence: [{MoveTo: {pose: a}, timeout: »5 kg}]}",
        "root: {sequence: [{MoveTo: {pose: a}, »timout: 5 s}]}",
        "root: {MoveTo: {pose: a}, retry: 2, on_failure: {sequence: [{Beep: {times: »99}}]}}",
        "root: {if: '1 == 1', then: {switch: '{v}', cases: {a: {Beep: {loud: »3}}}}, else: {set: {v: x}}}",
        "root: {Aim: {pose: {position: [1, 2, »3 kg], rpy: [0, 0, 0]}}}",
        "root: {Aim: {pose: {position: [1, 2, 3], »angles: [0, 0, 0]}}}",
        "root: {Aim: {hold: »loose}}",
        "root: {MoveTo: {pose: »~}}",
        "root: {ask: »}",
        "root: {ask: Go?, choices: [a, b], default: »c}",
        "root: {parallel: [{Beep: {}}, {wait: 1 s}], success_on: [Beep, »Bop]}",
        "parameters: {n: {type: int, default: »x}}\nroot: {Beep: {times: '{n}'}}",
        "parameters: {n: {type: int, default: 3, »mn: 1}}\nroot: {Beep: {times: '{n}'}}",
        "constants: {a: »'{b}'}\nroot: {check: '{a} == x'}",
        "subtrees: {s: {in: {»N: int}, root: {Beep: {}}}}\nroot: {s: {}}",
        "skills: {Beep: »[]}\nroot: {Beep: {}}",
    ],
)
def test_a_wrong_value_deep_in_a_file_is_pointed_at(findings_of, marked):
    text = HEAD + marked
    before = text[: text.index("»")]
    place = (before.count("\n") + 1, len(before) - before.rfind("\n"))
    assert place in [
        (finding.line, finding.column) for finding in findings_of(text.replace("»", ""))
    ]


def test_of_thousands_of_findings_the_first_are_written_out():
    found = read(HEAD + "".join(f"key_{number}: 1\n" for number in range(3000)), "t.yaml").findings
    assert len(found) == 3001
    lines = format_findings(found).splitlines()
    assert f"… and {3001 - MAX_SHOWN} more that are not shown" in lines
    assert lines[-1] == "3001 errors."


def test_a_word_of_thousands_of_characters_gets_no_suggestion():
    assert did_you_mean("Refine" * 1000, ["Refine"]) == ""
    assert did_you_mean("Refien", ["Refine", "Lift"]) == "did you mean 'Refine'?"


def test_a_constant_without_a_reader(findings_of):
    (finding,) = findings_of("constants: {a: 1}\nroot: {Beep: {}}")
    assert (finding.code, finding.severity) == ("unread", "warning")


def test_bytes_that_are_no_text_have_a_place(tmp_path):
    path = tmp_path / "t.yaml"
    path.write_bytes(b"pomona: 1\ntree: \xe9\n")
    with pytest.raises(UsageError, match=r"t\.yaml:2:7: not a text file"):
        read_text(path)


def test_an_irregular_file_is_called_by_its_name(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    for name, sort in ((".", "a folder"), ("pipe.yaml", "a pipe")):
        with pytest.raises(UsageError, match=f"a tree must be a regular file, this is {sort}"):
            find_tree(str(tmp_path / name))


def test_one_finding_is_kept_once():
    findings = Findings()
    where = YamlScalar(read(HEAD, "t.yaml").main.source, 1, 1, 1, 2, "", True)
    findings.error(where, "x", "y")
    findings.error(where, "x", "y")
    assert len(findings.sorted()) == 1
