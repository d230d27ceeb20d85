"""Trees go to Groot2's XML and come back the same."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from pomona.executive.language import TreeFileError, check, read
from pomona.executive.language.literals import scalar_of_any_type
from pomona.executive.language.model import Document, TreeNode
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlScalar
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot

HEAD = "pomona: 1\ntree: t\n"

TREES = [
    "root: {sequence: [{ask: 'Go?', choices: [a, b], answer: c, default: a, within: 3 s}, {check: '{c} == a'}]}",
    "root: {sequence: [{Beep: {}, disabled: true}, {MoveTo: {pose: a}, breakpoint: before}]}",
    "root: {sequence: [{Beep: {times: 3}}, {Beep: }, {Beep: {loud: true}, name: 'Beep & <tell>'}]}",
    "root: {reactive_sequence: [{check: '1 < 2'}, {reactive_fallback: [{Beep: {}}, {wait: 1.5 s}]}]}",
    "root: {parallel: [{Beep: {}, name: A}, {Beep: {}, name: B}], success_on: [A]}",
    "root: {parallel: [{Beep: {}}, {wait_until: '1 == 1'}], success_on: one}",
    "root: {recovery: [{MoveTo: {pose: a}}, {Beep: {}}], attempts: 4}",
    "root: {MoveTo: {pose: a}, timeout: 250 ms, retry: 3, repeat: forever, guard: '1 == 1', when: 'not 1 == 2'}",
    "root: {MoveTo: {pose: a}, retry: 3, retry_if: failure.code == NO_PATH, on_failure: {sequence: [{Beep: {}}]}}",
    "parameters: {n: {type: int, default: 3, max: 9, help: 'how often: \"n\"'}}\n"
    "root: {MoveTo: {pose: a}, retry: '{n} + 1', repeat: '{n}', invert: true}",
    "constants: {list: [1, 2], limit: 3 s}\nroot: {wait: '{limit}', for_each: '{list}', as: n, timeout: '{limit}'}",
    "root: {sequence: [{set: {a: 5 mm, b: '{c}'}}, {succeed: {}}, {fail: {}}, {fail: {code: X, message: 'a, b'}}]}",
    "root: {Aim: {pose: {position: [1, 2, 3 mm], rpy: [0, 0, 90 deg]}, hold: firm, share: 0.4}}",
    "root: {a: {x: 3}}\nsubtrees:\n"
    "  a: {in: {x: {type: int, default: 4}}, out: {y: text}, root: {b: {}, force: success}}\n"
    "  b: {description: a b, root: {Beep: {}, force: failure}}",
    "description: 'one: two'\nroot: {Beep: {}, description: it beeps}",
    "root: {if: '1 == 1', then: {Beep: {}}, else: {if: {MoveTo: {pose: a}}, then: {Beep: {}}}}",
    "root: {reactive_if: '1 == 1', then: {Beep: {}}, else: {Beep: {}}}",
    "root: {sequence: [{set: {v: a}}, {switch: '{v}', cases: {a: {Beep: {}}, b: {succeed: {}}}, default: {Beep: {}}}]}",
    "root: {sequence: [{set: {v: a}}, {switch: '{v}', cases: {a: {Beep: {}}}}]}",
    "root: {sequence_with_memory: [{Beep: {}, delay: 2 s, rate: 0.5 Hz}, {Beep: {}, run_once: true}]}",
    "root: {pipeline_sequence: [{round_robin: [{Beep: {}}, {Beep: {}}]}, {Beep: {}, delay: 1.5 ms}]}",
]


def canonical(document: Document) -> object:
    """All that a tree means, without places, comments and the way in which it is written."""
    return {
        definition.name: (
            {name: declared(port) for name, port in definition.inputs.items()},
            {name: declared(port) for name, port in definition.outputs.items()},
            {name: declared(port) for name, port in definition.file.parameters.items()}
            if definition.main
            else {},
            {name: declared(port) for name, port in definition.file.constants.items()}
            if definition.main
            else {},
            definition.description,
            node(definition.root) if definition.root else None,
        )
        for definition in document.definitions()
    }


def declared(port):
    known = (port.type.text if port.type else None, *(c.text for c in port.choices), port.help)
    return (*known, *(None if v is None else value(v) for v in (port.default, port.min, port.max)))


def node(found: TreeNode) -> object:
    modifiers = {k: value(v) for k, (_, v) in found.modifiers.items() if k != "on_failure"}
    if found.kind == "recovery":
        modifiers.setdefault("attempts", 2)
    simple = not (found.type.value.nodes or found.type.value.wires)
    return (
        found.kind,
        found.key.text,
        found.name.text if found.name else None,
        found.description or found.comment,
        value(found.value) if simple else None,
        {k: value(v) for k, (_, v) in found.ports.items()},
        modifiers,
        [node(child) for child in found.children],
        node(found.on_failure) if found.on_failure else None,
    )


def value(written):
    if isinstance(written, YamlScalar):
        plain = YamlScalar(written.source, 1, 1, 1, 1, written.text, True)
        return scalar_of_any_type(plain)
    if isinstance(written, YamlList):
        return [value(item) for item in written.items]
    assert isinstance(written, YamlMapping)
    return {key: value(inner) for key, (_, inner) in written.entries.items()}


def round_trip(text, skills):
    document = read(text, "t.yaml")
    xml = export_groot(document, skills)
    back, findings = import_groot(xml, "t.xml")
    assert findings == []
    again = read(back, "t.yaml")
    assert again.findings == []
    return document, again


@pytest.mark.parametrize("body", TREES)
def test_a_round_trip_keeps_the_tree(skills, body):
    document, again = round_trip(HEAD + body, skills)
    assert canonical(again) == canonical(document)


def test_a_round_trip_keeps_the_default_tree(skills, pick_apple):
    document, again = round_trip(pick_apple, skills)
    assert canonical(again) == canonical(document)


def test_every_node_has_a_model_with_every_port_that_is_used(skills, pick_apple):
    for text in (pick_apple, *(HEAD + body for body in TREES)):
        root = ElementTree.fromstring(export_groot(read(text, "t.yaml"), skills))
        models = {
            model.get("ID"): {port.get("name") for port in model if port.tag.endswith("_port")}
            for model in root.find("TreeNodesModel")
        }
        for tree in root.findall("BehaviorTree"):
            assert len(tree) == 1
            for element in tree.iter():
                name = element.get("ID") if element.tag == "SubTree" else element.tag
                if name in models and element is not tree:
                    used = {
                        key
                        for key in element.attrib
                        if key not in ("ID", "name") and not key.startswith("_")
                    }
                    assert used <= models[name], (name, used)


def test_names_that_mean_something_else_to_behaviortree_cpp_are_refused(skills):
    with pytest.raises(TreeFileError, match="groot-name"):
        export_groot(read(HEAD + "root: {Sleep: {}}", "t.yaml"), skills)


FOREIGN = """<root BTCPP_format="4">
  <BehaviorTree ID="MainTree">
    <Fallback name="root">
      <Inverter><RetryUntilSuccessful num_attempts="3"><Timeout msec="1500">
        <OpenDoor door="{door}" _skipIf="open"/>
      </Timeout></RetryUntilSuccessful></Inverter>
      <Action ID="PassWindow"/>
      <Timeout msec="100"><RetryUntilSuccessful num_attempts="2"><Sleep msec="50"/></RetryUntilSuccessful></Timeout>
      <SubTree ID="GoHome" where="home"/>
    </Fallback>
  </BehaviorTree>
  <BehaviorTree ID="GoHome"><AlwaysSuccess/></BehaviorTree>
</root>"""


def test_an_element_without_counterpart_keeps_its_children_and_is_refused(skills):
    text = '<root BTCPP_format="4"><BehaviorTree ID="a"><Mystery level="3"><Beep/><Beep/></Mystery></BehaviorTree></root>'
    translated, findings = import_groot(text, "x.xml")
    assert [finding.code for finding in findings] == ["not-translated"]
    document = read(translated, "x.yaml")
    assert [child.key.text for child in document.main.main.root.children] == ["Beep", "Beep"]
    assert [finding.code for finding in check(document, skills)] == ["untranslated"]
    back = export_groot(document, skills)
    assert '<Mystery level="3">' in back
    assert import_groot(back, "x.xml")[0] == translated


@pytest.mark.parametrize(
    ("xml", "expected"),
    [
        ("<IfThenElse><A/><B/><C/></IfThenElse>", "{if: {A: {}}, then: {B: {}}, else: {C: {}}}"),
        ("<IfThenElse><A/><B/></IfThenElse>", "{if: {A: {}}, then: {B: {}}, else: {fail: {}}}"),
        (
            "<WhileDoElse><Condition ID='A'/><B/><C/></WhileDoElse>",
            "{reactive_if: {A: {}}, then: {B: {}}, else: {C: {}}}",
        ),
        (
            "<Switch2 variable='{v}' case_1='1' case_2='x'><A/><B/><C/></Switch2>",
            "{switch: '{v}', cases: {1: {A: {}}, x: {B: {}}}, default: {C: {}}}",
        ),
        ("<Delay delay_msec='1500'><A/></Delay>", "{A: {}, delay: 1.5 s}"),
        ("<Timeout msec='{limit}'><A/></Timeout>", "{A: {}, timeout: '{limit} * 1 ms'}"),
        ("<RunOnce><A/></RunOnce>", "{A: {}, run_once: true}"),
        ("<KeepRunningUntilFailure><A/></KeepRunningUntilFailure>", "{A: {}, repeat: forever}"),
        ("<SequenceWithMemory><A/></SequenceWithMemory>", "{sequence_with_memory: [{A: {}}]}"),
        (
            "<Script code='x := 3; y = x + 1'/>",
            "{sequence: [{set: {x: 3}}, {set: {y: '{x} + 1'}}]}",
        ),
        ("<ScriptCondition code='a &amp;&amp; !(b > 3)'/>", "{check: '{a} and not ({b} > 3)'}"),
        ("<A _skipIf='open == true'/>", "{A: {}, when: 'not ({open} == true)'}"),
        ("<A _while='go'/>", "{reactive_if: '{go}', then: {A: {}}}"),
        ("<A _successIf='done'/>", "{if: '{done}', then: {succeed: {}}, else: {A: {}}}"),
        ("<A _failureIf='bad'/>", "{if: '{bad}', then: {fail: {}}, else: {A: {}}}"),
        (
            "<RecoveryNode number_of_retries='6'><A/><B/></RecoveryNode>",
            "{recovery: [{A: {}}, {B: {}}], attempts: 7}",
        ),
        (
            "<PipelineSequence><A/><B/></PipelineSequence>",
            "{pipeline_sequence: [{A: {}}, {B: {}}]}",
        ),
        ("<RoundRobin><A/><B/></RoundRobin>", "{round_robin: [{A: {}}, {B: {}}]}"),
        ("<RateController hz='1.5'><A/></RateController>", "{A: {}, rate: 1.5 Hz}"),
    ],
)
def test_words_of_behaviortree_cpp_and_nav2_mean_the_same(xml, expected):
    text, findings = import_groot(
        f'<root BTCPP_format="4"><BehaviorTree ID="t">{xml}</BehaviorTree></root>', "t.xml"
    )
    assert findings == []
    assert yaml.safe_load(text)["root"] == yaml.safe_load(expected)


def test_a_parallel_that_succeeds_on_two_goes_there_and_back(skills):
    xml = "<Parallel success_count='2' failure_count='1'><Beep/><Beep/><Beep/></Parallel>"
    text, findings = import_groot(
        f'<root BTCPP_format="4"><BehaviorTree ID="t">{xml}</BehaviorTree></root>', "t.xml"
    )
    assert findings == []
    assert "success_on: 2" in text
    assert check(read(text, "t.yaml"), skills) == []
    assert 'success_count="2"' in export_groot(read(text, "t.yaml"), skills)


@pytest.mark.parametrize(
    "xml",
    [
        "<A _onHalted='x := 1'/>",
        "<A _onSuccess='print(x)'/>",
        "<Timeout><A/></Timeout>",
        "<Script code='print(3)'/>",
        "<A _skipIf='a ? b : c'/>",
        "<RunOnce then_skip='false'><A/></RunOnce>",
        "<Parallel success_count='2' failure_count='2'><A/><B/><C/></Parallel>",
        "<UnsetBlackboard key='a'/>",
        "<ManualSelector><A/><B/></ManualSelector>",
        "<SpeedController><A/></SpeedController>",
        "<Inverter/>",
    ],
)
def test_an_element_without_equivalent_is_a_finding_and_the_check_refuses_it(skills, xml):
    text, findings = import_groot(
        f'<root BTCPP_format="4"><BehaviorTree ID="t">{xml}</BehaviorTree></root>', "t.xml"
    )
    assert [finding.code for finding in findings] == ["not-translated"]
    assert "untranslated" in [finding.code for finding in check(read(text, "t.yaml"), skills)]


class TestForeignFiles:
    def test_a_tree_made_for_behaviortree_cpp(self):
        text, findings = import_groot(FOREIGN, "door.xml")
        assert findings == []
        document = read(text, "door.yaml")
        assert document.findings == []
        root = document.main.main.root
        assert (root.kind, root.label, document.main.name) == ("fallback", "root", "main_tree")
        wrapper, window, slow, home = root.children
        assert (wrapper.kind, list(wrapper.modifiers)) == ("sequence", ["invert"])
        (door,) = wrapper.children
        assert door.decorators == ["timeout", "retry"]
        assert [(n.key.text, n.decorators) for n in door.children] == [("OpenDoor", ["when"])]
        assert door.children[0].modifiers["when"][1].text == "not ({open})"
        assert window.key.text == "PassWindow"
        assert slow.decorators == ["timeout"]
        assert slow.children[0].decorators == ["retry"]
        assert [child.key.text for child in home.children] == ["succeed"]

    @pytest.mark.parametrize(
        ("text", "code"),
        [
            ("", "xml"),
            ("<root", "xml"),
            ("<tree/>", "xml"),
            ('<root BTCPP_format="3"/>', "version"),
            ('<root BTCPP_format="4"/>', "xml"),
            ('<!DOCTYPE a [<!ENTITY b "c">]><root BTCPP_format="4"/>', "xml"),
            (FOREIGN.replace("AlwaysSuccess", "ManualSelector"), "not-translated"),
            (FOREIGN.replace('<SubTree ID="GoHome"', '<SubTree ID="Nowhere"'), "not-translated"),
            (FOREIGN.replace("<AlwaysSuccess/>", '<SubTree ID="GoHome" a="b"/>'), "not-translated"),
            (
                FOREIGN.replace(
                    '<BehaviorTree ID="M', '<include path="no.xml"/><BehaviorTree ID="M'
                ),
                "file",
            ),
            ('<root BTCPP_format="4"><BehaviorTree ID="a"/></root>', "xml"),
            ('<?xml version="1.0" encoding="no such"?><tree/>', "xml"),
            ("<a>" * 500 + "</a>" * 500, "too-deep"),
        ],
    )
    def test_an_unreadable_value_is_a_finding(self, text, code):
        assert code in [finding.code for finding in import_groot(text, "x.xml")[1]]


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        ('<SetBlackboard output_key="goal" value="{Home}"/>', 'root: {set: {goal: "{home}"}}'),
        ('<Script code="A:=1; B:=A"/>', 'set: {b: "{a}"}'),
        (
            "<TryCatch><Go/><Grip/><Back/></TryCatch>",
            'else:\n    sequence:\n      - Back: {}\n        force: success\n      - fail: {code: "{failure.code}"',
        ),
        (
            '<Precondition if="x < 3 && y > 1" else="SUCCESS"><Go/></Precondition>',
            'if: "{x} < 3 and {y} > 1"',
        ),
        (
            '<Precondition if="x" else="SKIPPED"><Go/></Precondition>',
            'if: "{x}"\n  then:\n    Go: {}\n',
        ),
        (
            '<LoopInt queue="1;2;3" value="{N}"><Go n="{N}"/></LoopInt>',
            "for_each: [1, 2, 3]\n  as: n_2",
        ),
        (
            '<KeepRunningUntilFailure><Go _skipIf="x"/></KeepRunningUntilFailure>',
            'when: "not ({x})"\n    - succeed: {}\n  repeat: forever',
        ),
        ("<KeepRunningUntilFailure><Go/></KeepRunningUntilFailure>", "Go: {}\n  repeat: forever"),
        ("<SequenceStar><Go/></SequenceStar>", "sequence_with_memory:"),
        ("<Script code=\"A := '1;2'; b := (1 + 0.5)\"/>", '- set: {a: "1;2"}\n    - set: {b: 1.5}'),
        (
            "<ScriptCondition code='n += 1; n >= 5'/>",
            '- set: {n: "{n} + (1)"}\n    - check: "{n} >= 5"',
        ),
        ("<Go to='{retry}'/>", 'Go: {to: "{retry_2}"}'),
        ("<Go _anything='1'/>", "root:\n  Go: {}\n"),  # BehaviorTree.CPP does not read it either
        (
            "<LoopInt queue='' if_empty='SKIPPED' value='{n}'><Go/></LoopInt>",
            "succeed: {}\n  disabled: true",
        ),
        (
            "<RetryUntilSuccessful num_attempts='-1'><Go/></RetryUntilSuccessful>",
            "- Go: {}\n      invert: true\n      repeat: forever\n  invert: true",
        ),
        (
            "<Go _onSuccess='n = 1'/>",
            "if:\n    Go: {}\n  then: {set: {n: 1}}\n  else:\n    fail: {code:",
        ),
        (
            "<Go _onFailure='n = 1' _post='done = true'/>",
            "then: {set: {done: true}}\n  else:\n    sequence:\n      - set: {n: 1}\n      - set: {done: true}\n",
        ),
        ("<Sequence><Go name='a'/><Go name='a'/></Sequence>", "name: a 2"),
    ],
)
def test_more_words_of_behaviortree_cpp_mean_the_same(xml, words):
    text, findings = import_groot(
        f'<root BTCPP_format="4"><BehaviorTree ID="T">{xml}</BehaviorTree></root>', "t.xml"
    )
    assert findings == []
    assert words in text
    assert read(text, "t.yaml").findings == []


@pytest.mark.parametrize(
    "xml",
    [
        "<WhileDoElse><Near/><Go/><Back/></WhileDoElse>",  # a node of which nobody says that it takes no time
        "<ParallelAll><Go/><Back/></ParallelAll>",  # lets all end, then fails
        "<WhileDoElse><Sleep msec='9'/><Go/><Back/></WhileDoElse>",  # what runs would go on unattended
        # BehaviorTree.CPP keeps the failure of what it has asked
        "<RetryUntilSuccessful num_attempts='2'><IfThenElse><Near/><Go/></IfThenElse></RetryUntilSuccessful>",
        "<ReactiveFallback><IfThenElse><Condition ID='A' _skipIf='x'/><Go/></IfThenElse><Back/></ReactiveFallback>",
        "<Precondition if='x' else='RUNNING'><Go/></Precondition>",
        "<TryCatch catch_on_halt='true'><Go/><Back/></TryCatch>",
        "<LoopInt queue='{q}' value='{n}'><Go/></LoopInt>",
        "<LoopInt queue='1;2' value='{n}' if_empty='FAILURE'><Go/></LoopInt>",
    ],
)
def test_a_change_of_meaning_is_refused(xml):
    text, findings = import_groot(
        f'<root BTCPP_format="4"><BehaviorTree ID="T">{xml}</BehaviorTree></root>', "t.xml"
    )
    assert [finding.code for finding in findings] == ["not-translated"]
    assert "untranslated" in text


@pytest.mark.parametrize(
    ("xml", "refused"),
    [
        ("<Repeat num_cycles='2'><Sequence><SubTree ID='S'/></Sequence></Repeat>", 1),
        ("<Sequence><SubTree ID='S'/></Sequence>", 0),  # asked once only
        ("<Sequence><Repeat num_cycles='2'><Go/></Repeat><SubTree ID='S'/></Sequence>", 0),
        (
            "<Fallback><SubTree ID='S'/><ReactiveSequence><SubTree ID='S'/></ReactiveSequence></Fallback>",
            1,
        ),
    ],
)
def test_an_if_without_an_else_is_refused_where_a_caller_may_start_it_again(xml, refused):
    trees = f"<BehaviorTree ID='T'>{xml}</BehaviorTree><BehaviorTree ID='S'><IfThenElse><A/><B/></IfThenElse>"
    text = f'<root BTCPP_format="4">{trees}</BehaviorTree></root>'
    findings = import_groot(text, "t.xml", main="T")[1]
    assert ["AlwaysFailure" in finding.message for finding in findings] == [True] * refused


def test_a_subtree_that_shares_its_callers_names_is_written_out():
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><Sequence>
        <Script code="goal := 1; Speed := 2"/>
        <SubTree ID="Go" _autoremap="true" target="{goal}"/>
        <SubTree ID="Go" _autoremap="1" target="{=}"/>
      </Sequence></BehaviorTree>
      <BehaviorTree ID="Go"><Move name="move" to="{target}" at="{Speed}"/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert findings == []
    assert text.count("- Move:") == 2
    assert 'to: "{goal}"' in text
    assert 'to: "{target}"' in text
    assert text.count('at: "{speed}"') == 2
    assert "subtrees" not in text
    assert read(text, "t.yaml").findings == []


def test_keys_of_its_own_get_names_of_their_own():
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><Sequence><Move to="{mine}"/><SubTree ID="Go" _autoremap="1"/></Sequence></BehaviorTree>
      <BehaviorTree ID="Go"><Move to="{_mine}" at="{mine}"/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert findings == []
    assert 'Move: {to: "{go_mine}", at: "{mine}"}' in text


def test_a_subtree_with_wires_and_texts_is_written_out():
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <TreeNodesModel><SubTree ID="Go"><input_port name="speed" default="2"/></SubTree></TreeNodesModel>
      <BehaviorTree ID="Main">
        <Sequence><SubTree ID="Go" to="{Goal}"/><SubTree ID="Go" to="home"/></Sequence>
      </BehaviorTree>
      <BehaviorTree ID="Go"><Move to="{to}" own="{x}" _skipIf="speed > 1 &amp;&amp; to == 'home'"/></BehaviorTree>
    </root>"""
    text, findings = import_groot(xml, "t.xml")
    assert findings == []
    assert (
        """Move: {to: "{goal}", own: "{go_x}"}\n          when: "not (2 > 1 and {goal} == 'home')\""""
        in text
    )
    assert (
        """Move: {to: home, own: "{go_x_2}"}\n          when: "not (2 > 1 and 'home' == 'home')\""""
        in text
    )


def test_a_subtree_that_writes_to_a_text_of_its_caller_is_refused():
    xml = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"><SubTree ID="Go" n="3"/></BehaviorTree>
      <BehaviorTree ID="Go"><Script code="n += 1"/></BehaviorTree>
    </root>"""
    assert [finding.code for finding in import_groot(xml, "t.xml")[1]] == ["not-translated"]


@pytest.mark.slow
def test_subtrees_that_explode_when_they_are_written_out_are_refused():
    tree = '<BehaviorTree ID="{}"><Sequence><SubTree ID="{}" a="1"/><SubTree ID="{}" a="1"/></Sequence></BehaviorTree>'
    trees = "".join(tree.format(f"T{i}", f"T{i + 1}", f"T{i + 1}") for i in range(15))
    xml = (
        f'<root main_tree_to_execute="T0">{trees}<BehaviorTree ID="T15"><A/></BehaviorTree></root>'
    )
    text, findings = import_groot(xml, "t.xml")
    assert {finding.code for finding in findings} == {"not-translated"}
    assert len(text) < 2**24


class TestSeveralFiles:
    @staticmethod
    def tree(name: str, inside: str, before: str = "") -> str:
        return f'<root BTCPP_format="4">{before}<BehaviorTree ID="{name}">{inside}</BehaviorTree></root>'

    def test_included_files_are_read(self, tmp_path):
        (tmp_path / "sub").mkdir()
        (tmp_path / "sub" / "go.xml").write_text(
            self.tree("Go", "<Move/>", '<include path="../home.xml"/>')
        )
        (tmp_path / "home.xml").write_text(self.tree("Home", "<Stop/>"))
        calls = '<Sequence><SubTree ID="Go"/><SubTree ID="Home"/></Sequence>'
        main = self.tree("Main", calls, '<include path="sub/go.xml"/>')
        text, findings = import_groot(main, tmp_path / "main.xml")
        assert findings == []
        assert list(yaml.safe_load(text)["subtrees"]) == ["home", "go"]

    @pytest.mark.parametrize("included", ["main.xml", "sub", "missing.xml", "", "\0"])
    def test_an_include_that_fails_is_a_finding(self, tmp_path, included):
        (tmp_path / "sub").mkdir()
        main = self.tree("Main", "<Move/>", f'<include path="{included}"/>')
        (tmp_path / "main.xml").write_text(main)
        findings = import_groot(main, tmp_path / "main.xml")[1]
        assert len(findings) == 1
        assert (findings[0].line, findings[0].column) == (1, 25 if included != "\0" else 39)

    def test_files_beside_hold_called_trees(self):
        text, findings = import_groot(
            self.tree("Main", '<SubTree ID="Go"/>'),
            "main.xml",
            beside=[(self.tree("Go", "<Move/>"), "go.xml")],
        )
        assert findings == []
        assert yaml.safe_load(text)["subtrees"] == {"go": {"root": {"Move": {}}}}

    def test_which_tree_runs(self):
        two = """<root><BehaviorTree ID="Go"><A/></BehaviorTree>
          <BehaviorTree ID="M"><SubTree ID="Go"/></BehaviorTree></root>"""
        text, findings = import_groot(two, "t.xml")
        assert (yaml.safe_load(text)["tree"], findings) == ("m", [])
        assert yaml.safe_load(import_groot(two, "t.xml", main="Go")[0])["tree"] == "go"
        unclear = two.replace('<SubTree ID="Go"/>', "<A/>")
        assert "does not name the main tree" in import_groot(unclear, "t.xml")[1][0].message

    def test_names_of_trees_stay_apart(self):
        calls = "".join(f'<SubTree ID="{name}"/>' for name in ("GoHome", "go_home", "sequence"))
        trees = "".join(
            f'<BehaviorTree ID="{n}"><{n[0].upper()}/></BehaviorTree>'
            for n in ("GoHome", "go_home", "sequence")
        )
        xml = f'<root><BehaviorTree ID="Main"><Sequence>{calls}</Sequence></BehaviorTree>{trees}</root>'
        text, findings = import_groot(xml, "t.xml", main="Main")
        assert findings == []
        assert list(yaml.safe_load(text)["subtrees"]) == ["go_home", "go_home_2", "sequence_2"]


class TestModelsOfNodes:
    MODELS = """<root><TreeNodesModel><Condition ID="Near"/>
      <Action ID="Move"><input_port name="to"/><input_port name="speed" default="1.5"/>
        <output_port name="at" default="{=}"/></Action>
      <Decorator ID="Careful"/>
    </TreeNodesModel></root>"""

    def read(self, xml):
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{xml}</BehaviorTree></root>'
        return import_groot(text, "t.xml", nodes=[(self.MODELS, "models.xml")])

    def test_ports_that_are_not_wired_have_the_models_defaults(self):
        text, findings = self.read('<Move to="home"/>')
        assert findings == []
        assert yaml.safe_load(text)["root"] == {"Move": {"to": "home", "speed": 1.5, "at": "{at}"}}

    @pytest.mark.parametrize(
        ("xml", "message"),
        [
            ('<Move where="home"/>', "no port 'where'"),
            ("<Careful><Move/></Careful>", "children"),
            ("<Careful/>", "Decor"),
        ],
    )
    def test_names_that_the_models_lack_are_refused(self, xml, message):
        (finding,) = self.read(xml)[1]
        assert message in finding.message

    def test_a_condition_takes_no_time(self):
        text, findings = self.read('<WhileDoElse><Near/><Move to="a"/><Move to="b"/></WhileDoElse>')
        assert findings == []
        assert yaml.safe_load(text)["root"]["reactive_if"] == {"Near": {}}

    def test_a_file_without_models_is_a_finding(self):
        assert [
            f.code for f in import_groot("<root/>", "t.xml", nodes=[("<root/>", "m.xml")])[1]
        ] == ["xml", "xml"]


@pytest.mark.parametrize(
    "tag", ["PomonaForEach", "PomonaTimeout", "PomonaRepeat", "Inverter", "Timeout"]
)
@pytest.mark.parametrize("count", [0, 2, 3])
def test_a_decorator_with_another_number_of_children_is_refused_with_its_place(tag, count):
    element = f'<{tag} items="{{i}}" item="{{o}}" msec="10">{"<Move/>" * count}</{tag}>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">\n{element}</BehaviorTree></root>'
    found = import_groot(text, "t.xml")[1]
    assert [(f.path, f.line) for f in found if f"{count} children" in f.message] == [("t.xml", 2)]


def test_a_subtree_that_hands_values_out_keeps_its_name_where_it_is_inlined() -> None:
    call = '<SubTree ID="MoveRobot" target="{goal}" result="{out}"/>'
    text = (
        f'<root BTCPP_format="4" main_tree_to_execute="a"><BehaviorTree ID="a"><Sequence>{call}{call}</Sequence>'
        '</BehaviorTree><BehaviorTree ID="MoveRobot"><Sequence><Beep times="{target}"/>'
        '<SetBlackboard output_key="result" value="done"/></Sequence></BehaviorTree></root>'
    )
    root = read(import_groot(text, "x.xml")[0], "x.yaml").main.main.root
    assert [child.name.text for child in root.children] == ["MoveRobot", "MoveRobot 2"]
