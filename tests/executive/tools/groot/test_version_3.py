"""Words of BehaviorTree.CPP 3 mean the same, or are refused."""

from __future__ import annotations

import pytest
import yaml

from pomona.executive.language import read
from pomona.tools.groot.import_xml import import_groot


def imported(inside: str, called: str = '<A x="{x}"/>') -> tuple[object, list[str]]:
    trees = (
        f'<BehaviorTree ID="T">{inside}</BehaviorTree><BehaviorTree ID="S">{called}</BehaviorTree>'
    )
    text, findings = import_groot(f'<root main_tree_to_execute="T">{trees}</root>', "t.xml")
    assert read(text, "t.yaml").findings == []
    return yaml.safe_load(text)["root"], [finding.message for finding in findings]


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        (
            '<Parallel success_threshold="1"><A/><B/></Parallel>',
            "{parallel: [{A: {}}, {B: {}}], success_on: one}",
        ),
        (
            '<Parallel success_threshold="2" failure_threshold="1"><A/><B/><C/></Parallel>',
            "{parallel: [{A: {}}, {B: {}}, {C: {}}], success_on: 2}",
        ),
        (
            '<Parallel threshold="2"><A/><B/></Parallel>',
            "{parallel: [{A: {}}, {B: {}}]}",
        ),  # one failure is too many
        ('<Parallel threshold="-1"><A/><B/></Parallel>', "{parallel: [{A: {}}, {B: {}}]}"),
        (
            '<Control ID="Parallel" threshold="2"><A/><B/></Control>',
            "{parallel: [{A: {}}, {B: {}}]}",
        ),
        ('<SubTreePlus ID="S" x="{place}"/>', "{sequence: [{A: {x: '{place}'}}], name: S}"),
        ('<SubTreePlus ID="S" x="home"/>', "{sequence: [{A: {x: home}}], name: S}"),
        ('<SubTreePlus ID="S" __autoremap="1"/>', "{sequence: [{A: {x: '{x}'}}], name: S}"),
        ('<SubTree ID="S" __shared_blackboard="true"/>', "{sequence: [{A: {x: '{x}'}}], name: S}"),
        (
            '<SubTree ID="S" __shared_blackboard="false" x="place"/>',
            "{sequence: [{A: {x: '{place}'}}], name: S}",
        ),
        (
            '<SequenceStar><SubTree ID="S" x="place"/></SequenceStar>',
            "{sequence_with_memory: [{sequence: [{A: {x: '{place}'}}], name: S}]}",
        ),
    ],
)
def test_a_word_of_version_3_means_the_same(xml: str, words: str) -> None:
    assert imported(xml) == (yaml.safe_load(words), [])


@pytest.mark.parametrize(
    ("xml", "why"),
    [
        (
            '<Parallel success_threshold="1" failure_threshold="2"><A/><B/><C/></Parallel>',
            "1 and fails on 2",
        ),
        ('<Parallel threshold="2"><A/><B/><C/></Parallel>', "2 and fails on 2"),
        ('<Parallel threshold="{n}"><A/><B/></Parallel>', "succeeds on {n}"),
        ('<SubTree ID="S" __shared_blackboard="yes"/>', "neither true nor false"),
        ('<SubTree ID="S" _autoremap="{x}"/>', "neither true nor false"),
        ('<SubTree ID="S" x="place"/>', "a key in version 3 and a text in version 4"),
        (
            '<SubTree ID="S" __shared_blackboard="true" x="{place}"/>',
            "shares its caller's blackboard",
        ),
        (
            '<BlackboardCheckInt value_A="{a}" value_B="1" return_on_mismatch="FAILURE"><A/></BlackboardCheckInt>',
            "no",
        ),
    ],
)
def test_a_word_of_version_3_without_equivalent_is_refused(xml: str, why: str) -> None:
    _, messages = imported(xml)
    assert [why in message for message in messages] == [True]


def test_a_subtree_that_shares_the_blackboard_writes_the_callers_key() -> None:
    call = '<Sequence><SubTree ID="S" __shared_blackboard="true"/><DropInto crate="{crate}"/></Sequence>'
    found, messages = imported(call, '<SetBlackboard output_key="crate" value="red"/>')
    assert messages == []
    shared = {"sequence": [{"set": {"crate": "red"}}], "name": "S"}
    assert found == {"sequence": [shared, {"DropInto": {"crate": "{crate}"}}]}


@pytest.mark.parametrize("private", ["_x", "x"])
def test_version_3_shares_keys_that_begin_with_an_underscore(private: str) -> None:
    found, _ = imported(f'<Sequence><A x="{{{private}}}"/><SubTreePlus ID="S" __autoremap="1"/></Sequence>',
                        f'<A x="{{{private}}}"/>')  # fmt: skip
    first, second = found["sequence"]
    assert second["sequence"] == [first]


@pytest.mark.parametrize(
    "new",
    ["<Script code='a := 1'/>", "<A _skipIf='a'/>", "<Parallel success_count='1'><A/></Parallel>",
     "<SubTree ID='S' x='{y}'/>", "<SubTree ID='S' _autoremap='1'/>"],
)  # fmt: skip
def test_a_word_of_version_4_shows_that_a_text_is_none_of_version_3s_keys(new: str) -> None:
    found, messages = imported(f'<Sequence>{new}<SubTree ID="S" x="home"/></Sequence>')
    assert messages == []
    assert found["sequence"][1]["sequence"] == [{"A": {"x": "home"}}]
