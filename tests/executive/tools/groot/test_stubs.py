"""Declarations of foreign nodes have the directions of their models."""

from __future__ import annotations

import pytest
import yaml

from pomona.executive.language import check, read
from pomona.executive.registry import Registry
from pomona.tools.groot.import_xml import import_groot

TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Main"><Sequence>
    <Recognise colour="{colour}" point="{point}" state="{state}"/><Drive to="{point}" now="{state}"/>
  </Sequence></BehaviorTree>
</root>"""
MODELS = """<TreeNodesModel>
    <Action ID="Recognise">
      <input_port name="colour"/><output_port name="point"/><inout_port name="state"/>
    </Action>
    <Action ID="Drive"><input_port name="to"/><inout_port name="now"/></Action>
  </TreeNodesModel>"""


@pytest.mark.parametrize("beside", [False, True])
def test_ports_have_the_directions_of_the_models(beside: bool) -> None:
    tree = TREE if beside else TREE.replace("</root>", f"{MODELS}</root>")
    nodes = [(f"<root>{MODELS}</root>", "models.xml")] if beside else []
    text, findings = import_groot(tree, "t.xml", nodes=nodes, stubs=True)
    assert findings == []
    declared = yaml.safe_load(text)["skills"]
    assert declared["Recognise"] == {"in": ["colour"], "out": ["point", "state"]}
    assert declared["Drive"] == {"in": ["to", "now"]}
    document = read(text, "t.yaml")
    found = check(document, Registry({}).declaring(document.main.declared_skills))
    assert [
        "'colour'" in finding.message or "{colour}" in finding.message for finding in found
    ] == [True]


def test_without_models_a_port_that_nothing_has_written_is_an_output() -> None:
    text, _ = import_groot(TREE, "t.xml", stubs=True)
    assert yaml.safe_load(text)["skills"] == {
        "Drive": {"in": ["to", "now"]},
        "Recognise": {"out": ["colour", "point", "state"]},
    }


def test_a_name_that_no_skill_can_have_is_reported_and_not_declared() -> None:
    text, findings = import_groot(
        '<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence><Action ID="Größe"/><Action ID="Grab"/></Sequence>'
        "</BehaviorTree></root>",
        "t.xml",
        stubs=True,
    )
    assert list(yaml.safe_load(text)["skills"]) == ["Grab"]
    assert "call it Grosse" in findings[0].message
