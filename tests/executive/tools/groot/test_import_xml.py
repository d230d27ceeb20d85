"""Foreign trees keep their meaning, or the import reports the place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from pomona.executive.language import check, read
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.ports import Port, Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.names import BUILTIN

NO_SKILLS = Registry({})
FOUR = ' BTCPP_format="4"'


def tree(inside: str, more: str = "", version: str = FOUR) -> str:
    return (
        f'<root{version} main_tree_to_execute="T">\n<BehaviorTree ID="T">\n{inside}\n</BehaviorTree>\n'
        f'<BehaviorTree ID="S"><Z at="{{place}}"/></BehaviorTree>{more}</root>'
    )


def imported(inside: str, more: str = "", version: str = FOUR) -> tuple[object, list[Finding]]:
    text, findings = import_groot(tree(inside, more, version), "t.xml")
    assert read(text, "t.yaml").findings == []
    return yaml.safe_load(text)["root"], findings


def refused(inside: str, more: str = "", version: str = FOUR) -> str:
    """Return the message about the only element that is not translated."""
    text, findings = import_groot(tree(inside, more, version), "t.xml")
    assert "untranslated:" in text
    (finding,) = findings
    assert finding.code == "not-translated"
    assert finding.line == 3
    return finding.message


NEEDS = {
    "Timeout": 'msec="9"', "Sleep": 'msec="9"', "Delay": 'delay_msec="9"', "Repeat": 'num_cycles="2"',
    "RetryUntilSuccessful": 'num_attempts="2"', "RetryUntilSuccesful": 'num_attempts="2"', "Script": 'code="a := 1"',
    "ScriptCondition": 'code="a == 1"', "SetBlackboard": 'output_key="a" value="1"', "Precondition": 'if="a == 1"',
    "LoopInt": 'queue="1;2" value="{n}"', "LoopDouble": 'queue="1;2" value="{n}"',
    "LoopBool": 'queue="true" value="{n}"', "LoopString": 'queue="a;b" value="{n}"',
    **{f"Switch{n}": 'variable="{v}" ' + " ".join(f'case_{i}="{i}"' for i in range(1, n + 1)) for n in range(2, 7)},
}  # fmt: skip
CHILDREN = {
    **dict.fromkeys(
        ["Script", "ScriptCondition", "SetBlackboard", "Sleep", "AlwaysSuccess", "AlwaysFailure"], 0
    ),
    **dict.fromkeys(
        ["LoopInt", "LoopDouble", "LoopBool", "LoopString", "Precondition", "ParallelAll"], 1
    ),
    **{f"Switch{n}": n + 1 for n in range(2, 7)},
}
HAVE_NO_COUNTERPART = {
    "ConsumeQueue", "EntryUpdated", "ManualSelector", "SkipUnlessUpdated", "TestNode", "UnsetBlackboard",
    "WaitValueUpdate", "WasEntryUpdated", "SubTreePlus", "BlackboardCheckInt", "BlackboardCheckDouble",
    "BlackboardCheckString", "BlackboardCheckBool",
}  # fmt: skip


def elements() -> list[tuple[str, str, str]]:
    """Return each element that has a translation, with the attributes and children that it needs."""
    types = NodeTypes.installed()
    foreign = {tag for word in types for tag in types[word].other_names}
    found = []
    for tag in sorted((foreign | BUILTIN) - HAVE_NO_COUNTERPART - {"SubTree"}):
        known = types.of_other_name(tag)
        number = CHILDREN.get(tag, 1 if known is not None and known.role == "modifier" else 2)
        children = "".join(["<Condition ID='C'/>", *(f"<A{i}/>" for i in range(number))][:number])
        found.append((tag, NEEDS.get(tag, ""), children))
    return found


@pytest.mark.parametrize(("tag", "needs", "children"), elements())
def test_each_attribute_of_a_known_element_is_read_or_reported(
    tag: str, needs: str, children: str
) -> None:
    assert imported(f"<{tag} {needs}>{children}</{tag}>")[1] == []
    assert "no port 'zzz'" in refused(f'<{tag} {needs} zzz="1">{children}</{tag}>')


@pytest.mark.parametrize(
    "xml",
    [
        '<RecoveryNode num_retries="6"><A/><B/></RecoveryNode>',
        '<Repeat num_cycles="2" cycles="9"><A/></Repeat>',
        '<Parallel success_threshold="1"><A/><B/></Parallel>',  # a word of version 3 in a file of version 4
        '<Parallel success_count="1" failure_threshold="1"><A/><B/></Parallel>',
        '<RateController rate="5"><A/></RateController>',
        '<KeepRunningUntilFailure times="3"><A/></KeepRunningUntilFailure>',
        "<Switch2 variable='{v}' case_1='1' case_2='2' case_3='3'><A/><B/><C/></Switch2>",
        "<Switch3 variable='{v}' case_1='1' case_3='3'><A/><B/><C/><D/></Switch3>",
        '<Sequence skipIf="a"><A/></Sequence>',
        '<Control ID="Sequence" level="1"><A/></Control>',
    ],
)
def test_a_misspelt_attribute_is_refused(xml: str) -> None:
    assert "has no port" in refused(xml) or "cases" in refused(xml)


@pytest.mark.parametrize(
    ("xml", "hint"),
    [
        ('<A _skipif="x"/>', "'_skipIf'"),
        ('<A _on_success="x := 1"/>', "'_onSuccess'"),
        ('<SubTree ID="S" autoremap="1"/>', "'_autoremap'"),
        ('<SubTree ID="S" __shared_blackboard="true"/>', "'_autoremap'"),
        ('<SubTree ID="S" __autoremap="true"/>', "'_autoremap'"),
        ('<Sequence ID="Grasp"><A/></Sequence>', "'name'"),
    ],
)
def test_an_attribute_that_behaviortree_cpp_ignores_by_its_spelling_is_reported(
    xml: str, hint: str
) -> None:
    (finding,) = imported(xml)[1]
    assert (finding.severity, finding.line) == ("warning", 3)
    assert hint in (finding.hint or "")


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        ('<Timeout msec="0"><A/></Timeout>', {"A": {}}),  # sets no timer
        ('<Delay delay_msec="0"><A/></Delay>', {"A": {}, "delay": "0 s"}),
        ('<Sleep msec="0"/>', {"wait": "0 s"}),
        (
            '<Parallel failure_count="2"><A/><B/></Parallel>',
            {"parallel": [{"A": {}}, {"B": {}}]},
        ),  # one is too many
        (
            "<RateController><A/></RateController>",
            {"A": {}, "rate": "10.0 Hz"},
        ),  # the default of Nav2's port
        ('<RateController hz="{Rate}"><A/></RateController>', {"A": {}, "rate": "{rate} * 1 Hz"}),
        ('<A x="{=}" y=" {y} " z="{@z}"/>', {"A": {"x": "{x}", "y": "{y}", "z": "{z}"}}),
        ('<Script code="@n := 1"/>', {"set": {"n": 1}}),
        ('<A text="&lt;a&gt; &amp; &quot;b&quot;&#10;c"/>', {"A": {"text": '<a> & "b"\nc'}}),
        ('<SetBlackboard output_key="größe" value="{Größe}"/>', {"set": {"grosse": "{grosse_2}"}}),
    ],
)
def test_an_attribute_has_the_meaning_of_behaviortree_cpp(xml: str, words: object) -> None:
    assert imported(xml) == (words, [])


@pytest.mark.parametrize(
    ("xml", "why"),
    [
        ('<Repeat num_cycles="0"><A/></Repeat>', "a whole number above 0"),
        ('<Repeat num_cycles="-2"><A/></Repeat>', "a whole number above 0"),
        (
            '<RetryUntilSuccessful num_attempts="0"><A/></RetryUntilSuccessful>',
            "a whole number above 0",
        ),
        (
            '<RetryUntilSuccessful num_attempts="three"><A/></RetryUntilSuccessful>',
            "a whole number above 0",
        ),
        ('<Timeout msec="-1"><A/></Timeout>', "milliseconds"),
        ('<Timeout msec="1.5"><A/></Timeout>', "milliseconds"),
        ('<Sleep msec="1 s"/>', "milliseconds"),
        (
            '<Switch2 variable="{v}" case_1="1" case_2="2"><A/><B/></Switch2>',
            "2 cases and a default",
        ),
        ('<ParallelAll max_failures="0"><A/></ParallelAll>', "lets all"),
        ('<A text="a {b} c"/>', "braces"),
        ("<A text='json:{\"x\": 1}'/>", "braces"),
        ('<SetBlackboard output_key="{key}" value="1"/>', "whose name"),
        ('<SubTree ID="S"><remap internal="a" external="b"/></SubTree>', "has children"),
        ("<S/>", '<SubTree ID="S"/>'),
        ('<Action name="x"/>', "has no ID"),
        ('<Action ID="Größe"/>', "call it Grosse"),
        ('<Action ID="看"/>', "call it Skill"),
        ('<Action ID="go home"/>', "call it GoHome"),
        ('<SubTreePlus ID="S"/>', "no counterpart"),
    ],
)
def test_an_attribute_that_cannot_be_carried_over_is_refused(xml: str, why: str) -> None:
    text, findings = import_groot(tree(xml), "t.xml")
    assert "untranslated:" in text
    assert {finding.code for finding in findings} == {"not-translated"}
    assert why in findings[0].message


def test_a_text_with_braces_that_a_subtree_is_called_with_is_refused() -> None:
    message = "reads the text 'a {b}'"
    _, findings = imported('<SubTree ID="S" place="a {b}"/>')
    assert [message in finding.message for finding in findings] == [True]


@pytest.mark.parametrize("children", ["", "<OpenValve/><CloseValve/>"])
@pytest.mark.parametrize("main", ["T", "U"])
@pytest.mark.parametrize("stubs", [False, True])
def test_a_tree_without_a_single_root_never_succeeds(children: str, main: str, stubs: bool) -> None:
    more = '<BehaviorTree ID="U"><SubTree ID="T"/></BehaviorTree>'
    text, findings = import_groot(tree(children, more), "t.xml", main=main, stubs=stubs)
    assert [finding.code for finding in findings] == ["xml"]
    document = read(text, "t.yaml")
    assert "succeed" not in text
    installed = NO_SKILLS.declaring(document.main.declared_skills)
    assert "untranslated" in [finding.code for finding in check(document, installed)]


class Follow(Skill):
    """Another thing than the robot's."""

    inputs = Ports(path=Port(str))


Follow.__module__ = "pomona.skills.motion.follow"


class TestNamesOfSkills:
    def test_a_foreign_node_is_not_a_skill_of_pomona_by_its_name(self) -> None:
        xml = tree('<Sequence><Follow/><Action ID="Follow" speed="2"/></Sequence>')
        text, findings = import_groot(xml, "t.xml", skills={"Follow": Follow}, stubs=True)
        assert [(f.code, f.severity, f.line) for f in findings] == [("renamed", "warning", 3)]
        assert yaml.safe_load(text)["skills"].keys() == {"ForeignFollow", "Z"}
        assert yaml.safe_load(text)["root"]["sequence"] == [
            {"ForeignFollow": {}},
            {"ForeignFollow": {"speed": 2}},
        ]

    def test_a_model_with_the_same_ports_makes_it_that_skill(self) -> None:
        model = '<root><TreeNodesModel><Action ID="Follow"><input_port name="path"/></Action></TreeNodesModel></root>'
        xml = tree('<Follow path="{p}"/>')
        text, findings = import_groot(
            xml, "t.xml", nodes=[(model, "m.xml")], skills={"Follow": Follow}
        )
        assert findings == []
        assert yaml.safe_load(text)["root"] == {"Follow": {"path": "{p}"}}

    def test_a_skill_of_another_package_is_meant_by_its_name(self) -> None:
        class OpenDoor(Skill):
            """Open the door."""

        assert import_groot(tree("<OpenDoor/>"), "t.xml", skills={"OpenDoor": OpenDoor})[1] == []

    def test_an_attribute_that_the_files_own_model_lacks_is_reported(self) -> None:
        more = (
            '<TreeNodesModel><Action ID="Drive"><input_port name="to"/></Action></TreeNodesModel>'
        )
        (finding,) = imported('<Drive too="{x}"/>', more)[1]
        assert (finding.code, finding.severity, finding.line) == ("unknown-port", "warning", 3)


class TestNamesOfTrees:
    XML = """<root BTCPP_format="4" main_tree_to_execute="摘苹果">
      <BehaviorTree ID="摘苹果"><Sequence><SubTree ID="看"/><SubTree ID="抓" name="grab"/></Sequence></BehaviorTree>
      <BehaviorTree ID="看"><Look/></BehaviorTree>
      <BehaviorTree ID="抓"><Grab/></BehaviorTree>
    </root>"""

    def test_names_that_are_not_ascii_are_reported_and_kept_at_the_calls(self) -> None:
        text, findings = import_groot(self.XML, "t.xml")
        assert [(finding.code, finding.line) for finding in findings] == [
            ("renamed", 2),
            ("renamed", 3),
            ("renamed", 4),
        ]
        calls = yaml.safe_load(text)["root"]["sequence"]
        assert [call["name"] for call in calls] == ["看", "grab"]
        assert read(text, "t.yaml").findings == []

    def test_accents_are_left_out(self) -> None:
        text, findings = import_groot(self.XML.replace("摘苹果", "GrößeMessen"), "t.xml")
        assert yaml.safe_load(text)["tree"] == "grosse_messen"
        assert "'grosse_messen'" in findings[0].message


@pytest.mark.parametrize(
    "calls",
    [
        {"T": "T"},
        {"T": "U", "U": "T"},
        {"T": "U", "U": "V", "V": "U"},
    ],
)
@pytest.mark.parametrize("how", ["", 'x="{x}"', '_autoremap="1"', '__shared_blackboard="true"'])
def test_trees_that_call_each_other_in_a_circle_are_refused(
    calls: dict[str, str], how: str
) -> None:
    trees = "".join(
        f'<BehaviorTree ID="{tree_id}"><Sequence><A x="{{x}}"/><SubTree ID="{called}" {how}/></Sequence></BehaviorTree>'
        for tree_id, called in calls.items()
    )
    text, findings = import_groot(f'<root main_tree_to_execute="T">{trees}</root>', "t.xml")
    assert {f.code for f in findings} == {"not-translated"}
    assert all("calls itself" in f.message for f in findings)
    assert "element: SubTree" in text


def test_a_byte_order_mark_is_no_part_of_the_file() -> None:
    assert import_groot("\ufeff" + tree("<A/>"), "t.xml")[1] == []


def test_an_included_file_is_read_in_its_own_version(tmp_path: Path) -> None:
    old = '<root><BehaviorTree ID="Old"><Parallel success_threshold="1"><A/><B/></Parallel></BehaviorTree></root>'
    (tmp_path / "old.xml").write_text("\ufeff" + old, encoding="utf-8")
    main = tree('<SubTree ID="Old"/>').replace("main_tree", "main_tree", 1)
    main = re.sub(r"(<root[^>]*>)", r'\1<include path="old.xml"/>', main)
    text, findings = import_groot(main, tmp_path / "main.xml")
    assert findings == []
    assert "success_on: one" in text
