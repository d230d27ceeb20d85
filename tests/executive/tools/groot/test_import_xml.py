"""Foreign trees keep their meaning, or the import names the place and writes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from pomona.executive.language import check, read
from pomona.executive.ports import Port, Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding
from pomona.tools.groot.elements import READERS
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.names import NO_SKILLS


def tree(inside: str, more: str = "") -> str:
    return (
        '<root BTCPP_format="4" main_tree_to_execute="T">\n<BehaviorTree ID="T">\n'
        f'{inside}\n</BehaviorTree>\n<BehaviorTree ID="S"><Z at="{{place}}"/></BehaviorTree>{more}</root>'
    )


def imported(inside: str, more: str = "") -> tuple[object, list[Finding]]:
    text, findings = import_groot(tree(inside, more), "t.xml")
    assert read(text, "t.yaml").findings == []
    return yaml.safe_load(text)["root"], findings


def refused(inside: str, more: str = "") -> str:
    """Return the message about the only element that is refused."""
    text, findings = import_groot(tree(inside, more), "t.xml")
    assert text == ""
    (finding,) = findings
    assert (finding.code, finding.severity, finding.line) == ("not-translated", "error", 3)
    return f"{finding.message}; {finding.hint}"


# ---------------------------------------------------------------------------------------------- meaning


@pytest.mark.parametrize(
    ("xml", "expected"),
    [
        ("<IfThenElse><A/><B/><C/></IfThenElse>", "{if: {A: {}}, then: {B: {}}, else: {C: {}}}"),
        (
            "<WhileDoElse><Condition ID='A'/><B/></WhileDoElse>",
            "{reactive_if: {A: {}}, then: {B: {}}, else: {fail: {}}}",
        ),
        (
            "<Switch2 variable='{v}' case_1='1' case_2='x'><A/><B/><C/></Switch2>",
            "{switch: '{v}', cases: {1: {A: {}}, x: {B: {}}}, default: {C: {}}}",
        ),
        ("<Delay delay_msec='1500'><A/></Delay>", "{A: {}, delay: 1.5 s}"),
        ("<Delay delay_msec='0'><A/></Delay>", "{A: {}, delay: 0 s}"),
        ("<Timeout msec='{limit}'><A/></Timeout>", "{A: {}, timeout: '{limit} * 1 ms'}"),
        ("<Timeout msec='0'><A/></Timeout>", "{A: {}}"),  # sets no timer
        (
            "<Timeout msec='9'><Inverter><Timeout msec='5'><A/></Timeout></Inverter></Timeout>",
            "{sequence: [{A: {}, timeout: 5 ms, invert: true}], timeout: 9 ms}",
        ),
        ("<Sleep msec='0'/>", "{wait: 0 s}"),
        ("<RunOnce><A/></RunOnce>", "{A: {}, run_once: true}"),
        ("<ForceFailure><A/></ForceFailure>", "{A: {}, force: failure}"),
        ("<Repeat num_cycles='-1'><A/></Repeat>", "{A: {}, repeat: forever}"),
        ("<RetryUntilSuccessful num_attempts='{n}'><A/></RetryUntilSuccessful>", "{A: {}, retry: '{n}'}"),
        (
            "<RetryUntilSuccessful num_attempts='-1'><A/></RetryUntilSuccessful>",
            "{sequence: [{sequence: [{A: {}}], invert: true, repeat: forever}], invert: true}",
        ),
        (  # it goes on when its child is skipped
            "<KeepRunningUntilFailure><A/></KeepRunningUntilFailure>",
            "{sequence: [{A: {}}, {succeed: {}}], repeat: forever}",
        ),
        ("<AsyncSequence><A/></AsyncSequence>", "{sequence: [{A: {}}]}"),
        ("<SequenceWithMemory><A/></SequenceWithMemory>", "{sequence_with_memory: [{A: {}}]}"),
        ("<ReactiveFallback><A/></ReactiveFallback>", "{reactive_fallback: [{A: {}}]}"),
        (  # the second failure is one too many
            "<Parallel failure_count='2'><A/><B/></Parallel>",
            "{parallel: [{A: {}}, {B: {}}]}",
        ),
        (
            "<Parallel success_count='2'><A/><B/><C/></Parallel>",
            "{parallel: [{A: {}}, {B: {}}, {C: {}}], success_on: 2}",
        ),
        ("<Script code='x := 3; y = x + 1'/>", "{sequence: [{set: {x: 3}}, {set: {y: '{x} + 1'}}]}"),
        ("<Script code='n += 1'/>", "{set: {n: '{n} + (1)'}}"),
        ("<Script code=\"A := '1;2'; b := (1 + 0.5)\"/>", "{sequence: [{set: {a: 1;2}}, {set: {b: 1.5}}]}"),
        ("<Script code=\"a := '1'; b := true; c := -2\"/>",
         "{sequence: [{set: {a: '1'}}, {set: {b: true}}, {set: {c: -2}}]}"),
        ("<Script code='A:=1; B:=A'/>", "{sequence: [{set: {a: 1}}, {set: {b: '{a}'}}]}"),
        ("<Script code='@n := 1'/>", "{set: {n: 1}}"),
        ("<ScriptCondition code='a &amp;&amp; !(b > 3)'/>", "{check: '{a} and (not ({b} > 3))'}"),
        ("<ScriptCondition code='n += 1; n >= 5'/>", "{sequence: [{set: {n: '{n} + (1)'}}, {check: '{n} >= 5'}]}"),
        ("<SetBlackboard output_key='goal' value='{Home}'/>", "{set: {goal: '{home}'}}"),
        ("<SetBlackboard output_key='größe' value='{Größe}'/>", "{set: {grosse: '{grosse_2}'}}"),
        ("<Precondition if='x' else='SKIPPED'><A/></Precondition>", "{if: '{x}', then: {A: {}}}"),
        ("<Precondition if='x &lt; 3'><A/></Precondition>", "{if: '{x} < 3', then: {A: {}}, else: {fail: {}}}"),
        ("<A _skipIf='open == true'/>", "{A: {}, when: 'not ({open} == true)'}"),
        ("<A _while='go'/>", "{reactive_if: '{go}', then: {A: {}}}"),
        ("<A _successIf='done'/>", "{if: '{done}', then: {succeed: {}}, else: {A: {}}}"),
        ("<A _failureIf='bad'/>", "{if: '{bad}', then: {fail: {}}, else: {A: {}}}"),
        (
            "<A _onSuccess='n = 1'/>",
            "{if: {A: {}}, then: {sequence: [{set: {n: 1}}]},"
            " else: {fail: {code: '{failure.code}', message: '{failure.message}'}}}",
        ),
        (
            "<A _onFailure='n = 1' _post='m = 2'/>",
            "{if: {A: {}}, then: {sequence: [{set: {m: 2}}]}, else: {sequence: [{set: {n: 1}}, {set: {m: 2}},"
            " {fail: {code: '{failure.code}', message: '{failure.message}'}}]}}",
        ),
        ("<A x='{=}' y=' {y} ' z='{@z}'/>", "{A: {x: '{x}', y: '{y}', z: '{z}'}}"),
        ("<A to='{retry}'/>", "{A: {to: '{retry_2}'}}"),  # a word of expressions
        ("<A x='null' y='1:30' z='a: b' w='- 3'/>", "{A: {x: 'null', y: '1:30', z: 'a: b', w: '- 3'}}"),
        ("<Sequence><A name='a'/><A name='a'/></Sequence>", "{sequence: [{A: {}, name: a}, {A: {}, name: a 2}]}"),
        ("<A name='go' _description='it goes'/>", "{A: {}, name: go, description: it goes}"),
    ],
)  # fmt: skip
def test_an_element_of_behaviortree_cpp_keeps_its_meaning(xml: str, expected: str) -> None:
    assert imported(xml) == (yaml.safe_load(expected), [])


def test_a_text_keeps_its_signs() -> None:
    root, findings = imported('<A text="&lt;a&gt; &amp; &quot;b&quot;&#10;c"/>')
    assert (root, findings) == ({"A": {"text": '<a> & "b"\nc'}}, [])


# ---------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("xml", "why"),
    [
        ("<A _onHalted='x := 1'/>", "interruption"),
        ("<A _onSuccess='print(x)'/>", "more than assign"),
        ("<A _skipIf='a ? b : c'/>", "no expression"),
        ("<Script code='print(3)'/>", "more than assign"),
        ("<Script code=''/>", "empty script"),
        ("<Timeout><A/></Timeout>", "milliseconds"),
        ("<Timeout msec='1.5'><A/></Timeout>", "milliseconds"),
        ("<Sleep msec='1 s'/>", "milliseconds"),
        ("<Repeat num_cycles='0'><A/></Repeat>", "a whole number above 0"),
        ("<RetryUntilSuccessful num_attempts='three'><A/></RetryUntilSuccessful>", "a whole number above 0"),
        ("<RunOnce then_skip='false'><A/></RunOnce>", "repeats its first result"),
        ("<Parallel success_count='2' failure_count='2'><A/><B/><C/></Parallel>", "fails on 2"),
        ("<Parallel success_count='{n}'><A/><B/></Parallel>", "succeeds on {n}"),
        ("<Parallel success_threshold='1'><A/><B/></Parallel>", "no port 'success_threshold'"),
        ("<IfThenElse><A/><B/></IfThenElse>", "<AlwaysFailure/> as its third child"),
        ("<WhileDoElse><Near/><A/><B/></WhileDoElse>", "take time"),
        ("<WhileDoElse><Sleep msec='9'/><A/><B/></WhileDoElse>", "take time"),
        ("<WhileDoElse><Sequence><Condition ID='C'/><Near/></Sequence><A/></WhileDoElse>", "take time"),
        ("<Switch2 variable='{v}' case_1='1' case_2='2'><A/><B/></Switch2>", "2 children instead of 3"),
        ("<Switch2 variable='{v}' case_1='1' case_2='1'><A/><B/><C/></Switch2>", "stand twice"),
        ("<Switch2 variable='{v}' case_1='1' case_2='2' case_3='3'><A/><B/><C/></Switch2>", "no port 'case_3'"),
        ("<Precondition if='x' else='RUNNING'><A/></Precondition>", "ends as RUNNING"),
        ("<Sequence skipIf='a'><A/></Sequence>", "no port 'skipIf'"),
        ("<Sequence ID='Grasp'><A/></Sequence>", "no port 'ID'"),
        ("<Sequence/>", "0 children"),
        ("<Inverter><A/><B/></Inverter>", "2 children instead of 1"),
        ("<AlwaysSuccess><A/></AlwaysSuccess>", "1 children instead of 0"),
        ("<A text='a {b} c'/>", "signs"),
        ("<A text='json:{\"x\": 1}'/>", "signs"),
        ("<SetBlackboard output_key='{key}' value='1'/>", "holds its name"),
        ("<SubTree ID='S'><remap internal='a' external='b'/></SubTree>", "has children"),
        ("<SubTree ID='S' _autoremap='{x}'/>", "neither true nor false"),
        ("<SubTree ID='Nowhere'/>", "none of the files defines"),
        ("<SubTree ID='S' place='a {b}'/>", "signs"),
        ("<S/>", '<SubTree ID="S"/>'),
        ("<Action name='x'/>", "has no ID"),
        ("<Action ID='Größe'/>", "call it Grosse"),
        ("<Action ID='看'/>", "call it Skill"),
        ("<Action ID='go home'/>", "call it GoHome"),
        ("<PomonaCheck condition='1 == 1'/>", "no counterpart"),
    ],
)  # fmt: skip
def test_a_change_of_meaning_is_refused_with_its_place(xml: str, why: str) -> None:
    text, findings = import_groot(tree(xml), "t.xml")
    assert text == ""
    assert {(finding.code, finding.line) for finding in findings} <= {
        ("not-translated", 3),
        ("not-translated", 5),
    }
    assert why in f"{findings[0].message}; {findings[0].hint}"


@pytest.mark.parametrize("name", sorted({*READERS, *NO_SKILLS, "RateController"}))
def test_a_control_node_is_never_declared_as_a_skill(name: str) -> None:
    for xml in (f'<Action ID="{name}"/>', f'<Condition ID="{name}"/>'):
        assert name in refused(xml)
    text, findings = import_groot(tree(f"<{name}/>"), "t.xml", stubs=True)
    assert name in ("AlwaysSuccess", "AlwaysFailure") or name in findings[0].message
    assert name not in (yaml.safe_load(text) or {}).get("skills", ())


@pytest.mark.parametrize(
    "xml",
    [
        '<Careful level="3"><A/></Careful>',
        '<Decorator ID="Careful"><A/></Decorator>',
        '<Control ID="Careful"/>',
    ],
)
def test_an_unknown_control_node_is_refused_by_its_name(xml: str) -> None:
    assert "<Careful> is a control node" in refused(xml)


def test_a_control_node_of_the_models_is_no_skill() -> None:
    more = '<TreeNodesModel><Decorator ID="Careful"/></TreeNodesModel>'
    assert "<Careful> is a control node" in refused("<Careful/>", more)


def test_all_refusals_are_named_at_once() -> None:
    xml = "<Careful>\n<Sequence>\n<Repeat num_cycles='0'><A/></Repeat>\n<B x='{y} z'/></Sequence></Careful>"
    findings = import_groot(tree(xml), "t.xml")[1]
    assert [finding.line for finding in findings] == [3, 5, 6]


@pytest.mark.parametrize(
    ("xml", "name"),
    [('<A _skipif="x"/>', "_skipif"), ('<SubTree ID="S" __autoremap="1"/>', "__autoremap")],
)
def test_an_attribute_that_behaviortree_cpp_ignores_by_its_spelling_is_reported(
    xml: str, name: str
) -> None:
    (finding,) = imported(xml)[1]
    assert (finding.severity, finding.line) == ("warning", 3)
    assert f"'{name}'" in finding.message


# --------------------------------------------------------------------------------------------- skills


class Follow(Skill):
    """Another thing than the robot's."""

    inputs = Ports(path=Port(str))


Follow.__module__ = "pomona.skills.motion.follow"
MODELS = """<TreeNodesModel>
    <Action ID="Recognise">
      <input_port name="colour" default="red"/><output_port name="point"/><inout_port name="state"/>
    </Action>
    <Action ID="Drive"><input_port name="to"/><inout_port name="now"/></Action>
    <Condition ID="Near"/>
  </TreeNodesModel>"""


def test_a_foreign_node_is_no_skill_of_pomona_by_its_name() -> None:
    text, findings = import_groot(tree("<Follow/>"), "t.xml", skills={"Follow": Follow})
    assert (text, findings[0].line) == ("", 3)
    assert "the name of a skill of Pomona" in findings[0].message
    more = '<TreeNodesModel><Action ID="Follow"><input_port name="path"/></Action></TreeNodesModel>'
    found = import_groot(tree('<Follow path="{p}"/>', more), "t.xml", skills={"Follow": Follow})
    assert (yaml.safe_load(found[0])["root"], found[1]) == ({"Follow": {"path": "{p}"}}, [])


def test_a_skill_of_another_package_is_meant_by_its_name() -> None:
    class OpenDoor(Skill):
        """Open the door."""

    assert import_groot(tree("<OpenDoor/>"), "t.xml", skills={"OpenDoor": OpenDoor})[1] == []


def test_an_attribute_that_the_model_lacks_is_reported() -> None:
    (finding,) = imported('<Drive too="{x}"/>', MODELS)[1]
    assert (finding.code, finding.severity, finding.line) == ("unknown-port", "warning", 3)


def test_a_port_that_is_not_wired_has_its_models_default() -> None:
    assert imported('<Recognise point="{p}"/>', MODELS) == (
        {"Recognise": {"point": "{p}", "colour": "red"}},
        [],
    )


def test_a_condition_of_the_models_takes_no_time() -> None:
    root, findings = imported("<WhileDoElse><Near/><A/><B/></WhileDoElse>", MODELS)
    assert findings == []
    assert root["reactive_if"] == {"Near": {}}


RECOGNISE = """<Sequence><Recognise colour="{colour}" point="{point}" state="{state}"/>
    <Drive to="{point}" now="{state}"/></Sequence>"""


@pytest.mark.parametrize("beside", [False, True])
def test_declared_skills_have_the_directions_of_the_models(beside: bool) -> None:
    xml = tree(RECOGNISE, "" if beside else MODELS)
    files = [(f"<root>{MODELS}</root>", "models.xml")] if beside else []
    text, findings = import_groot(xml, "t.xml", beside=files, stubs=True)
    assert findings == []
    declared = yaml.safe_load(text)["skills"]
    assert declared["Recognise"] == {"in": ["colour"], "out": ["point", "state"]}
    assert declared["Drive"] == {"in": ["to", "now"]}
    document = read(text, "t.yaml")
    found = check(document, Registry({}).declaring(document.main.declared_skills))
    assert [
        "'colour'" in finding.message for finding in found if "place" not in finding.message
    ] == [True]


def test_without_models_a_port_that_nothing_has_written_is_an_output() -> None:
    text, _ = import_groot(tree(RECOGNISE), "t.xml", stubs=True)
    declared = yaml.safe_load(text)["skills"]
    assert declared["Drive"] == {"in": ["to", "now"]}
    assert declared["Recognise"] == {"out": ["colour", "point", "state"]}


# --------------------------------------------------------------------------------------------- subtrees


def test_a_subtree_that_shares_its_callers_names_is_written_out() -> None:
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><Sequence>
        <Script code="goal := 1; Speed := 2"/>
        <SubTree ID="Go" _autoremap="true" target="{goal}"/>
        <SubTree ID="Go" _autoremap="1" target="{=}"/>
      </Sequence></BehaviorTree>
      <BehaviorTree ID="Go"><Move name="move" to="{target}" at="{Speed}" own="{_x}"/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert findings == []
    _, first, second = yaml.safe_load(text)["root"]["sequence"]
    assert first["sequence"] == [
        {"Move": {"to": "{goal}", "at": "{speed}", "own": "{go_x}"}, "name": "move"}
    ]
    assert second["sequence"] == [
        {"Move": {"to": "{target}", "at": "{speed}", "own": "{go_x_2}"}, "name": "move 2"}
    ]
    assert (first["name"], second["name"]) == ("Go", "Go 2")
    assert read(text, "t.yaml").findings == []


def test_a_subtree_with_wires_texts_and_defaults_is_written_out() -> None:
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <TreeNodesModel><SubTree ID="Go"><input_port name="speed" default="2"/></SubTree></TreeNodesModel>
      <BehaviorTree ID="Main">
        <Sequence><SubTree ID="Go" to="{Goal}"/><SubTree ID="Go" to="home"/></Sequence>
      </BehaviorTree>
      <BehaviorTree ID="Go"><Move to="{to}" own="{x}" _skipIf="speed > 1 &amp;&amp; to == 'home'"/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert findings == []
    first, second = yaml.safe_load(text)["root"]["sequence"]
    assert first["sequence"] == [
        {"Move": {"to": "{goal}", "own": "{go_x}"}, "when": "not (2 > 1 and {goal} == 'home')"}
    ]
    assert second["sequence"] == [
        {"Move": {"to": "home", "own": "{go_x_2}"}, "when": "not (2 > 1 and 'home' == 'home')"}
    ]


def test_a_subtree_that_writes_to_a_text_of_its_caller_is_refused() -> None:
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><SubTree ID="Go" n="3"/></BehaviorTree>
      <BehaviorTree ID="Go"><Script code="n += 1"/></BehaviorTree>
    </root>"""
    text, (finding,) = import_groot(xml, "t.xml")
    assert (text, finding.line) == ("", 3)
    assert "which the caller gives as a text" in finding.message


def test_a_port_of_a_subtree_without_wire_and_default_is_refused() -> None:
    more = '<TreeNodesModel><SubTree ID="S"><input_port name="place"/></SubTree></TreeNodesModel>'
    assert "does not wire the port 'place'" in refused('<SubTree ID="S"/>', more)


@pytest.mark.parametrize(
    "calls", [{"T": "T"}, {"T": "U", "U": "T"}, {"T": "U", "U": "V", "V": "U"}]
)
@pytest.mark.parametrize("how", ["", 'x="{x}"', '_autoremap="1"'])
def test_trees_that_call_each_other_in_a_circle_are_refused(
    calls: dict[str, str], how: str
) -> None:
    trees = "".join(
        f'<BehaviorTree ID="{tree_id}"><Sequence><A x="{{x}}"/><SubTree ID="{called}" {how}/></Sequence></BehaviorTree>'
        for tree_id, called in calls.items()
    )
    xml = f'<root BTCPP_format="4" main_tree_to_execute="T">{trees}</root>'
    text, findings = import_groot(xml, "t.xml")
    assert text == ""
    assert all("calls itself" in finding.message for finding in findings)


@pytest.mark.slow
def test_subtrees_that_explode_when_they_are_written_out_are_refused() -> None:
    one = '<BehaviorTree ID="{}"><Sequence><SubTree ID="{}" a="1"/><SubTree ID="{}" a="1"/></Sequence></BehaviorTree>'
    trees = "".join(one.format(f"T{i}", f"T{i + 1}", f"T{i + 1}") for i in range(15))
    trees += '<BehaviorTree ID="T15"><A/></BehaviorTree>'
    xml = f'<root BTCPP_format="4" main_tree_to_execute="T0">{trees}</root>'
    text, findings = import_groot(xml, "t.xml")
    assert (text, {finding.code for finding in findings}) == ("", {"not-translated"})


# ------------------------------------------------------------------------------------------------ files


def one(name: str, inside: str, before: str = "") -> str:
    return (
        f'<root BTCPP_format="4">{before}<BehaviorTree ID="{name}">{inside}</BehaviorTree></root>'
    )


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "xml"),
        ("<root", "xml"),
        ("<tree/>", "xml"),
        ('<root BTCPP_format="4"/>', "xml"),
        ('<root BTCPP_format="4"><BehaviorTree><A/></BehaviorTree></root>', "xml"),
        ('<root BTCPP_format="3"><BehaviorTree ID="a"><A/></BehaviorTree></root>', "version"),
        ('<root><BehaviorTree ID="a"><A/></BehaviorTree></root>', "version"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><root BTCPP_format="4"/>', "xml"),
        ('<root BTCPP_format="4"><BehaviorTree ID="a"/></root>', "not-translated"),
        ('<root BTCPP_format="4"><BehaviorTree ID="a"><A/><B/></BehaviorTree></root>', "not-translated"),
        (one("a", "<A/>") + " ", ""),
        ("<a>" * 500 + "</a>" * 500, "too-deep"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_tree_of_version_4_is_refused(text: str, code: str) -> None:
    written, findings = import_groot(text, "x.xml")
    assert {finding.code for finding in findings} == ({code} if code else set())
    assert bool(written) == (not code)


def test_included_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "go.xml").write_text(one("Go", "<Move/>", '<include path="../home.xml"/>'))
    (tmp_path / "home.xml").write_text("\ufeff" + one("Home", "<Stop/>"), encoding="utf-8")
    calls = '<Sequence><SubTree ID="Go"/><SubTree ID="Home"/></Sequence>'
    text, findings = import_groot(
        one("Main", calls, '<include path="sub/go.xml"/>'), tmp_path / "m.xml"
    )
    assert findings == []
    assert list(yaml.safe_load(text)["subtrees"]) == ["home", "go"]


@pytest.mark.parametrize("included", ["main.xml", "sub", "missing.xml", "", "\0"])
def test_an_include_that_fails_is_a_finding(tmp_path: Path, included: str) -> None:
    (tmp_path / "sub").mkdir()
    main = one("Main", "<Move/>", f'<include path="{included}"/>')
    (tmp_path / "main.xml").write_text(main)
    (finding,) = import_groot(main, tmp_path / "main.xml")[1]
    assert (finding.line, finding.column) == (1, 25 if included != "\0" else 39)


def test_files_beside_hold_called_trees() -> None:
    beside = [(one("Go", "<Move/>"), "go.xml")]
    text, findings = import_groot(one("Main", '<SubTree ID="Go"/>'), "main.xml", beside=beside)
    assert findings == []
    assert yaml.safe_load(text)["subtrees"] == {"go": {"root": {"Move": {}}}}


def test_the_main_tree_is_the_named_one_or_one_without_callers() -> None:
    two = """<root BTCPP_format="4"><BehaviorTree ID="Go"><A/></BehaviorTree>
      <BehaviorTree ID="M"><SubTree ID="Go"/></BehaviorTree></root>"""
    text, findings = import_groot(two, "t.xml")
    assert (yaml.safe_load(text)["tree"], findings) == ("m", [])
    assert yaml.safe_load(import_groot(two, "t.xml", main="Go")[0])["tree"] == "go"
    unclear = two.replace('<SubTree ID="Go"/>', "<A/>")
    assert "does not name the main tree" in import_groot(unclear, "t.xml")[1][0].message


def test_names_of_trees_stay_apart() -> None:
    names = ("GoHome", "go_home", "sequence")
    calls = "".join(f'<SubTree ID="{name}"/>' for name in names)
    trees = "".join(f'<BehaviorTree ID="{name}"><A/></BehaviorTree>' for name in names)
    text, findings = import_groot(tree(f"<Sequence>{calls}</Sequence>", trees), "t.xml")
    assert findings == []
    assert {"go_home", "go_home_2", "sequence_2"} <= yaml.safe_load(text)["subtrees"].keys()


def test_names_that_are_not_ascii_are_reported_and_kept_at_the_calls() -> None:
    xml = """<root BTCPP_format="4" main_tree_to_execute="GrößeMessen">
      <BehaviorTree ID="GrößeMessen"><Sequence><SubTree ID="看"/><SubTree ID="抓" name="grab"/></Sequence></BehaviorTree>
      <BehaviorTree ID="看"><Look/></BehaviorTree>
      <BehaviorTree ID="抓"><Grab/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert [(finding.code, finding.line) for finding in findings] == [
        ("renamed", 2),
        ("renamed", 3),
        ("renamed", 4),
    ]
    found = yaml.safe_load(text)
    assert found["tree"] == "grosse_messen"
    assert [call["name"] for call in found["root"]["sequence"]] == ["看", "grab"]
    assert read(text, "t.yaml").findings == []
