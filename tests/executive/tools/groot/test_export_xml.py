"""Trees become XML that Groot2 opens; words that both languages have come back the same."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from pomona.executive.language import TreeFileError, read
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot

HEAD = "pomona: 1\ntree: t\n"

SHARED = [
    "root: {sequence: [{Beep: {times: 3}}, {Beep: {}}, {Beep: {loud: true}, name: 'Beep & <tell>'}]}",
    "root: {reactive_sequence: [{Beep: {}}, {reactive_fallback: [{Beep: {}}, {wait: 1.5 s}]}]}",
    "root: {parallel: [{Beep: {}}, {fallback: [{succeed: {}}, {fail: {}}]}], success_on: one}",
    "root: {parallel: [{Beep: {}}, {Beep: {}}, {Beep: {}}], success_on: 2}",
    "root: {MoveTo: {pose: a}, timeout: 250 ms, retry: 3}",
    "root: {sequence: [{MoveTo: {pose: a}, invert: true, repeat: forever}], force: success}",
    "root: {sequence_with_memory: [{Beep: {}, delay: 2 s}, {Beep: {}, run_once: true}]}",
    "root: {if: {MoveTo: {pose: a}}, then: {Beep: {}}, else: {Beep: {}}}",
    "root: {sequence: [{set: {v: a}}, {switch: '{v}', cases: {a: {Beep: {}}, b: {succeed: {}}}, default: {Beep: {}}}]}",
    "root: {a: {}}\nsubtrees: {a: {root: {Beep: {}, force: failure}}}",
    "root: {sequence: [{Beep: {}}], description: it beeps}",
]
OWN = [
    "root: {sequence: [{ask: 'Go?', choices: [a, b], answer: c, within: 3 s}, {check: '{c} == a'}]}",
    "root: {sequence: [{Beep: {}, disabled: true}, {MoveTo: {pose: a}, breakpoint: before}]}",
    "root: {MoveTo: {pose: a}, guard: '1 == 1', when: 'not 1 == 2'}",
    "root: {MoveTo: {pose: a}, retry: 3, retry_if: failure.code == NO_PATH, on_failure: {sequence: [{Beep: {}}]}}",
    "constants: {list: [1, 2]}\nroot: {wait: '{limit}', for_each: '{list}', as: n, timeout: '2 * {limit}'}",
    "root: {parallel: [{Beep: {}, name: A}, {Beep: {}, name: B}], success_on: [A]}",
    "root: {sequence: [{set: {a: 5 mm, b: '{c}'}}, {fail: {code: X, message: 'a, b'}}]}",
    "root: {Aim: {pose: {position: [1, 2, 3 mm], rpy: [0, 0, 90 deg]}, hold: firm, share: 0.4}}",
    "root: {reactive_if: '1 == 1', then: {Beep: {}}}",
]


@pytest.mark.parametrize("body", SHARED)
def test_words_of_both_languages_come_back_the_same(skills, body):
    xml = export_groot(read(HEAD + body, "t.yaml"), skills)
    text, findings = import_groot(xml, "t.xml", skills=skills)
    assert findings == []
    assert yaml.safe_load(text) == yaml.safe_load(HEAD + body)


@pytest.mark.parametrize("body", OWN)
def test_a_word_of_pomona_alone_is_a_node_for_groot_and_is_not_imported(skills, body):
    xml = export_groot(read(HEAD + body, "t.yaml"), skills)
    text, findings = import_groot(xml, "t.xml", skills=skills)
    assert "<Pomona" in xml or 'pose="yaml:{' in xml
    assert (text, {finding.code for finding in findings}) == ("", {"not-translated"})


def test_every_node_has_a_model_with_every_port_that_is_used(skills, pick_apple):
    for text in (pick_apple, *(HEAD + body for body in (*SHARED, *OWN))):
        root = ElementTree.fromstring(export_groot(read(text, "t.yaml"), skills))
        models = {
            model.get("ID"): {port.get("name") for port in model}
            for model in root.find("TreeNodesModel")
        }
        for tree in root.findall("BehaviorTree"):
            assert len(tree) == 1
            for element in tree.iter():
                if element.tag.startswith("Pomona") or element.tag in skills:
                    used = {key for key in element.attrib if key[0] != "_"} - {"name"}
                    assert used <= models[element.tag], (element.tag, used)


@pytest.mark.parametrize("name", ["Sleep", "SubTree", "ManualSelector", "PomonaCheck"])
def test_a_skill_whose_name_means_something_else_to_behaviortree_cpp_is_refused(skills, name):
    with pytest.raises(TreeFileError, match="groot-name"):
        export_groot(read(f"{HEAD}root: {{{name}: {{}}}}", "t.yaml"), skills)


def test_a_port_whose_name_means_something_else_to_behaviortree_cpp_is_refused(skills):
    with pytest.raises(TreeFileError, match="a port named '_skipIf'"):
        export_groot(read(f"{HEAD}root: {{Beep: {{_skipIf: a}}}}", "t.yaml"), skills)
