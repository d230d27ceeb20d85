"""A package outside of this repository adds words to the language; everything knows them, or refuses them whole."""

from __future__ import annotations

import importlib.util
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import jsonschema
import pytest
import yaml

from pomona.executive.language import build, check, read
from pomona.executive.nodes import Modifier, NodeTypeError, NodeTypes, catalogue, takes
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.skill_testing import BenchContext
from pomona.tools.dashboard.drawing import show_svg, show_text
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.listings.schema import schema

PACKAGE = "pomona_more_words"


class Beep(Skill):
    """Make a noise."""

    failures = ("MUTE",)

    def run(self) -> None:
        return None


SKILLS = Registry({"Beep": Beep})
TREE = """\
pomona: 1
tree: t
root:
  take_turns:
    - Beep: {}
      name: A
      paced: 5 Hz
      because: the horn is hot
    - wait: 100 ms
  repeat: 4
"""


@pytest.fixture(scope="module")
def words():
    here = Path(__file__).parent / "more_words" / "__init__.py"
    spec = importlib.util.spec_from_file_location(PACKAGE, here)
    module = sys.modules[PACKAGE] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[PACKAGE]


@pytest.fixture
def installed(words, monkeypatch):
    """The words that are found when the package is installed."""

    def offer(**classes):
        points = [
            EntryPoint(name, f"{PACKAGE}:{cls}", catalogue.GROUP) for name, cls in classes.items()
        ]
        monkeypatch.setattr(
            catalogue, "entry_points", lambda group: points if group == catalogue.GROUP else []
        )
        NodeTypes.installed.cache_clear()
        return NodeTypes.installed()

    yield offer
    monkeypatch.undo()
    NodeTypes.installed.cache_clear()


@pytest.fixture
def types(installed):
    return installed(take_turns="TakeTurnsType", paced="PacedType")


def test_check_knows_them(types):
    assert types.problems == {}
    assert check(read(TREE, "t.yaml"), SKILLS) == []
    wrong = read(TREE.replace("5 Hz", "5").replace("wait: 100 ms", "Bep: {}"), "t.yaml")
    assert [finding.code for finding in check(wrong, SKILLS)] == ["value", "unknown-skill"]
    alone = read("pomona: 1\ntree: t\nroot: {Beep: {}, because: why}", "t.yaml")
    assert [(f.code, "paced" in f.message) for f in check(alone, SKILLS)] == [("missing-key", True)]


def test_the_data_flow_goes_through_them(types):
    text = "pomona: 1\ntree: t\nroot: {sequence: [{take_turns: [{set: {x: 1}}, {succeed: {}}]}, {check: '{x} > 0'}]}"
    assert [finding.code for finding in check(read(text, "t.yaml"), SKILLS)] == ["unset"]
    both = text.replace("{succeed: {}}", "{set: {x: 2}}")
    assert check(read(both, "t.yaml"), SKILLS) == []


def test_build_makes_their_behaviours(types):
    context = BenchContext()
    tree = build(read(TREE, "t.yaml"), SKILLS, context=context)
    assert [(info.path, info.kind) for info in tree.nodes] == [
        ("t:repeat", "repeat"), ("t", "take_turns"), ("t/A:paced", "paced"), ("t/A", "skill"), ("t/wait", "wait"),
    ]  # fmt: skip
    while tree.root.status.name != "SUCCESS":
        tree.root.tick_once()
        context.clock.advance(0.02)
    assert tree.behaviours["t/A"].starts == 2
    assert context.clock.now() >= 0.2


def test_the_dashboard_and_the_record_get_them(types):
    nodes = {
        info.path: info.facts()
        for info in build(read(TREE, "t.yaml"), SKILLS, context=BenchContext()).nodes
    }
    assert nodes["t/A:paced"]["settings"] == {"paced": "5 Hz", "because": "the horn is hot"}
    assert nodes["t"]["type"] == "take_turns"


def test_the_schema_completes_them(types):
    made = schema(SKILLS)
    validator = jsonschema.Draft202012Validator(made)
    assert [error.message for error in validator.iter_errors(yaml.safe_load(TREE))] == []
    assert not validator.is_valid(yaml.safe_load(TREE.replace("5 Hz", "5 kg")))
    assert not validator.is_valid(yaml.safe_load(TREE.replace("paced: 5 Hz", "name2: x")))
    assert made["$defs"]["node"]["properties"]["paced"]["description"] == "ticks a second at most"


def test_show_draws_them(types):
    text = show_text(read(TREE, "t.yaml"))
    assert "⟲ take_turns  repeat 4" in text
    assert "● A (Beep)  paced 5 Hz · because the horn is hot" in text
    assert "⟲" in show_svg(read(TREE, "t.yaml"))


def test_groot_draws_them(types):
    xml = export_groot(read(TREE, "t.yaml"), SKILLS)
    assert '<PomonaPaced value="5 Hz" because="the horn is hot">' in xml
    assert '<Control ID="PomonaTakeTurns"' in xml


def test_a_question_of_theirs_is_asked_and_shown_with_its_answers(installed):
    installed(signed="SignedType")
    document = read("pomona: 1\ntree: t\nroot: {wait: 1 s, signed: {}}", "t.yaml")
    assert check(document, SKILLS) == []
    tree = build(document, SKILLS, context=BenchContext())
    assert tree.nodes[0].facts()["choices"] == ["signed"]
    (question,) = tree.questions.values()
    tree.root.tick_once()
    assert question.answer(question.starts, "signed")


def test_a_half_declared_type_is_refused_and_named(installed):
    types = installed(no_flow="NoFlow", paced="PacedType")
    assert types.problems == {"no_flow": "node type NoFlow lacks written_ports"}
    assert "paced" in types
    text = "pomona: 1\ntree: t\nroot: {no_flow: [{Beep: {}}]}"
    (finding,) = check(read(text, "t.yaml"), SKILLS)
    assert (finding.code, finding.line) == ("broken-node", 3)
    assert "lacks written_ports" in finding.message


def test_a_package_that_raises_is_a_problem_and_no_traceback(installed):
    types = installed(x="NotThere", broken="Broken", paced="PacedType")
    assert "cannot be used: AttributeError" in types.problems["x"]
    assert "cannot be used: RuntimeError: of its own making" in types.problems["broken"]
    assert "paced" in types


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ({"symbol": "x", "value": takes.Nothing()}, "lacks key"),
        ({"key": "x", "value": takes.Nothing()}, "lacks symbol"),
        ({"key": "x", "symbol": "x"}, "lacks value"),
        ({"key": "X", "symbol": "x", "value": takes.Nothing()}, "lower-case letters"),
        ({"key": "x", "symbol": "xy", "value": takes.Nothing()}, "one character"),
        ({"key": "x", "symbol": 5, "value": takes.Nothing()}, "one character"),
        ({"key": "x", "symbol": "x", "value": 3}, "no Field for x"),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "role": "modifyer"},
            "one of composite, leaf, modifier",
        ),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "fields": {"y": 3}},
            "no Field for y",
        ),
        ({"key": "x", "symbol": "x", "value": takes.Nothing(), "fields": ["y"]}, "no mapping"),
        (
            {
                "key": "x",
                "symbol": "x",
                "value": takes.Nothing(),
                "fields": {"on_failure": takes.Nothing()},
            },
            "is taken",
        ),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "xml_tags": ("X",)},
            "are called other_names now",
        ),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "other_names": ("Repeat",)},
            "belongs to 'repeat'",
        ),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "__init__": lambda self, n: None},
            "without arguments",
        ),
        ({"key": "retry", "symbol": "x", "value": takes.Nothing()}, "'retry' is taken"),
        (
            {"key": "x", "symbol": "x", "value": takes.Nothing(), "outside_of": "nowhere"},
            "no modifier named",
        ),
    ],
)
def test_an_incomplete_type_is_reported_when_it_is_registered(body, message):
    cls = type(
        "Incomplete",
        (Modifier,),
        {"__doc__": "does x", "build": lambda self, at: at.inside(), **body},
    )
    with pytest.raises(NodeTypeError, match=message):
        NodeTypes().register(cls)
    undocumented = type("Incomplete", (Modifier,), {"build": lambda self, at: at.inside(), **body})
    with pytest.raises(NodeTypeError):
        NodeTypes().register(undocumented)


def test_every_word_of_the_language_is_complete():
    assert NodeTypes().problems == {}
    assert all(found.summary for found in NodeTypes().values())
