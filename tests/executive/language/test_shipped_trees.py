"""The trees that come with the package, checked with the skills that are installed."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import jsonschema
import pytest
import yaml

from pomona.executive.language import check, format_findings, read_file
from pomona.executive.language.read import read
from pomona.executive.registry import Registry
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.listings.schema import schema
from pomona.tools.scenarios.run_scenario import run_scenario
from pomona.tools.scenarios.scenario import read_scenario

FOLDER = Path(__file__).resolve().parents[3] / "trees"
TREES = sorted(FOLDER.glob("*.yaml"))
SCENARIOS = sorted((FOLDER / "scenarios").glob("*.yaml"))


@pytest.fixture(scope="module")
def installed():
    return Registry.installed()


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_it_has_no_findings(installed, path):
    assert format_findings(check(read_file(path), installed)) == ""


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_the_schema_accepts_it(installed, path):
    jsonschema.Draft202012Validator(schema(installed)).validate(yaml.safe_load(path.read_text()))


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_groot_draws_every_node_of_it(installed, path):
    document = read_file(path)
    root = ElementTree.fromstring(export_groot(document, installed))
    names = {element.get("name") for element in root.iter()} - {None}
    nodes = [node for d in document.definitions() if d.root is not None for node in d.root.walk()]
    assert {node.name.text for node in nodes if node.name is not None} <= names


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_its_scenarios_go_as_expected_and_reach_every_node(installed, path):
    result = run_scenario(read_scenario(path.read_text(), path, installed), installed)
    assert [(case.case.name, case.problems) for case in result.cases if not case.passed] == []
    assert [info.path for info in result.coverage.unreached()] == []


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("{m.dimensions[0]} > 3 kg", "a length and a mass cannot be compared"),
        ("{m.dimensions[7]} > 3 mm", "there is no element 7: this has 3"),
        ("{m.fruit.dimensions[3]} > 3 mm", "there is no element 3: this has 3"),
        ("{d.score} > 3 N", "a ratio and a force cannot be compared"),
    ],
)
def test_values_between_skills_have_units(installed, condition, message):
    text = f"""pomona: 1
tree: t
root:
  sequence:
    - Detect: {{fruit: apple, detection: "{{d}}"}}
    - Refine: {{detection: "{{d}}", measured: "{{m}}"}}
    - check: "{{m.inlier_ratio}} > 0.5"
    - check: "{condition}"
"""
    assert [finding.message for finding in check(read(text, "t.yaml"), installed)] == [message]
