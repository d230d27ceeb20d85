"""The JSON Schema of tree files."""

from __future__ import annotations

import jsonschema
import pytest
import yaml

from pomona.tools.schema.tree_schema import schema

HEAD = "pomona: 1\ntree: t\n"


@pytest.fixture
def validator(skills):
    made = schema(skills)
    jsonschema.Draft202012Validator.check_schema(made)
    return jsonschema.Draft202012Validator(made)


class TestSchema:
    def test_the_default_tree_is_valid(self, validator, pick_apple):
        validator.validate(yaml.safe_load(pick_apple))

    @pytest.mark.parametrize(
        "body",
        [
            "root: {parallel: [{Beep: {}}, {wait: 3 s}], success_on: one}",
            "root: {Retreat: , timeout: 3 s, retry: '{n}', when: '1 == 1'}\nparameters: {n: {type: int, default: 3}}",
            "root: {Aim: {hold: firm, share: 0.4, pose: {position: [1, 2, 3]}}}",
            "root: {look: {}}\nsubtrees: {look: {root: {succeed: {}}}, there: {file: there.yaml}}",
            "root: {Beep: {times: 3, loud: true}, repeat: forever}",
        ],
    )
    def test_valid(self, validator, body):
        assert [e.message for e in validator.iter_errors(yaml.safe_load(HEAD + body))] == []

    @pytest.mark.parametrize(
        "body",
        [
            "root: {Beepp: {}}",
            "root: {Beep: {tims: 3}}",
            "root: {Beep: {times: 11}}",
            "root: {Beep: {}, MoveTo: {pose: a}}",
            "root: {MoveTo: {}}",
            "root: {Retreat: {distance: 3}}",
            "root: {Retreat: {distance: 3 deg}}",
            "root: {Detect: {fruit: apple, policy: neerest}}",
            "root: {Detect: {fruit: apple, detection: there}}",
            "root: {sequence: []}",
            "root: {Beep: {}, timeout: 3}",
            "root: {Beep: {}, on_failure: {Beep: {}}}",
            "root: {timeout: 3 s}",
            "rot: {Beep: {}}",
            "root: {Beep: {}}\nparameters: {n: {type: inch}}",
        ],
    )
    def test_invalid(self, validator, body):
        assert not validator.is_valid(yaml.safe_load(HEAD + body))

    def test_it_lists_units_and_failure_codes(self, skills):
        made = schema(skills)["$defs"]
        assert "NO_PATH" in made["skill.Plan"]["description"]
        assert "1 mm" in str(made["skill.Retreat"]["properties"]["distance"])
