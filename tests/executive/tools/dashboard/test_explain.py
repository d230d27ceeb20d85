"""The place of the skill that failed, in the explanation of a run."""

from __future__ import annotations

import inspect
import re
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from recorded_events import FAILED

from pomona.executive import registry
from pomona.executive.reasons import Reason
from pomona.executive.running.events import (
    AttemptEnded,
    NodeChanged,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
)
from pomona.executive.views import TableView
from pomona.tools.dashboard.explain import explain

WEIGH = '''"""A third party's skill."""

from pomona.executive.skill import Skill


class Weigh(Skill):
    """Weigh a fruit."""

    def run(self) -> None:
        return None
'''


def reason_of(skill: str, **facts: object) -> str:
    """Return the sentence that explains a run in which the skill at line 12 of the tree failed."""
    node = {
        "path": "a/Node",
        "parent": "a",
        "kind": "skill",
        "name": "Mine",
        "type": skill,
        "line": 12,
    } | facts
    failed = Reason("a/Node", "LOST", "it fell")
    events = [
        replace(
            event,
            nodes=(
                {"path": "a", "parent": None, "kind": "sequence", "name": "a", "type": "sequence"},
                node,
            ),
        )
        if isinstance(event, RunStarted)
        else replace(event, reason=failed)
        if isinstance(event, RunEnded)
        else event
        for event in FAILED
        if isinstance(event, (RunStarted, RunEnded))
    ]
    return next(text for text in explain(events, whole=False) if text.startswith("The reason"))


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A skill Weigh in a module of its own, which is installed."""
    (tmp_path / "scales_of_mine.py").write_text(WEIGH)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "scales_of_mine", raising=False)
    offered = EntryPoint("Weigh", "scales_of_mine:Weigh", registry.GROUP)
    monkeypatch.setattr(
        registry, "entry_points", lambda group: (offered,) if group == registry.GROUP else ()
    )
    return tmp_path


def test_a_skill_of_pomona_is_named_with_its_file_inside_the_package_and_its_line() -> None:
    from pomona.skills.move_to import MoveTo

    line = inspect.getsourcelines(MoveTo)[1]
    assert (
        f"Mine (line 12 of the tree, pomona/skills/move_to.py:{line}) failed with LOST: it fell."
        in reason_of("MoveTo")
    )


def test_every_installed_skill_is_named_with_a_file_that_exists() -> None:
    found = {
        name: registry.source_of(name).rpartition(":")[0] for name in registry.Registry.installed()
    }
    folders = [
        Path(registry.__file__).parents[3] / floor for floor in ("executive", "skills", "drivers")
    ]
    assert [
        name
        for name, file in found.items()
        if not any((folder / file).is_file() for folder in folders)
    ] == []


def test_a_third_partys_skill_is_named_with_its_module_and_no_folder_of_the_machine(
    third_party: Path,
) -> None:
    said = reason_of("Weigh")
    assert "Mine (line 12 of the tree, scales_of_mine:6) failed" in said
    assert str(third_party) not in said


def test_a_skill_that_is_not_installed_or_was_mocked_has_the_line_of_the_tree_alone(
    third_party: Path,
) -> None:
    assert "Mine (line 12 of the tree) failed" in reason_of("NoSuchSkill")
    assert "Mine (line 12 of the tree) failed" in reason_of("Weigh", mocked=True)
    (third_party / "scales_of_mine.py").write_text("raise RuntimeError('no scales')\n")
    assert "Mine (line 12 of the tree) failed" in reason_of("Weigh")


def test_a_skill_without_source_has_the_line_of_the_tree_alone(
    third_party: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_source(_thing: object) -> None:
        raise OSError("could not get source code")

    monkeypatch.setattr(inspect, "getsourcelines", no_source)
    assert "Mine (line 12 of the tree) failed" in reason_of("Weigh")


def test_a_condition_that_did_not_hold_is_no_failure_on_the_way() -> None:
    started = next(event for event in FAILED if isinstance(event, RunStarted))
    ended = next(event for event in FAILED if isinstance(event, RunEnded))
    decided = NodeChanged(
        1.0, 1, "a/Node", "FAILURE", "", 1, Reason("a/Node", "CONDITION_FALSE", "it is false")
    )
    events = [started, decided, replace(ended, outcome="success", reason=None)]
    assert "Nothing failed on the way." in list(explain(events, whole=False))


def test_the_account_that_is_shown_as_a_table_is_a_sentence_of_its_own() -> None:
    account, other = "7 of 8 fruit put away; left at (10, 20) mm: no grasp", "Gripped with 9 N"
    table = TableView(("fruit",), (("1",),), account)
    shown = [
        Published(0.1, 1, "KeepTally", "tally", table),
        PortWritten(0.1, 1, "/so_far", {}, "KeepTally", account),
    ]
    events = [
        *FAILED[:-1],
        *shown,
        PortWritten(0.2, 1, "/hold", {}, "SlipAvoidGrasp", other),
        FAILED[-1],
    ]
    paragraphs = explain(events, whole=False)
    assert f"{account}." in paragraphs
    assert not any(other in paragraph for paragraph in paragraphs)
    assert f"{account}." not in explain(FAILED, whole=False)


def test_a_long_account_is_cut_at_the_end_of_a_part() -> None:
    parts = [
        "7 of 40 fruit put away",
        *(f"left at ({n}, 20) mm: none of 3 grasps was free" for n in range(33)),
    ]
    account = "; ".join(parts)
    shown = Published(0.1, 1, "KeepTally", "tally", TableView(("fruit",), (("1",),), account))
    events = [
        *FAILED[:-1],
        shown,
        PortWritten(0.1, 1, "/tally", {}, "KeepTally", account),
        FAILED[-1],
    ]
    (cut,) = (text for text in explain(events, whole=False) if text.startswith(parts[0]))
    kept, _, rest = cut.rpartition("; … ")
    assert kept == "; ".join(parts[: kept.count("; ") + 1])
    assert 5 < kept.count("; ") < 33
    assert rest == "the rest with --all."


def attempts_of(*failures: tuple[int, str, bool]) -> list[str]:
    """Return the sentences about attempts (inner number, code, whether it succeeded) of a retry in another one."""
    nodes = (
        {"path": "a", "parent": None, "kind": "sequence", "name": "a", "type": "sequence"},
        {"path": "a/0", "parent": "a", "kind": "decorator", "name": "outer", "type": "retry"},
        {"path": "a/0/0", "parent": "a/0", "kind": "decorator", "name": "inner", "type": "retry"},
        {"path": "a/0/0/Lift", "parent": "a/0/0", "kind": "skill", "name": "Lift", "type": "Lift"},
    )  # fmt: skip
    (begun,) = [replace(event, nodes=nodes) for event in FAILED if isinstance(event, RunStarted)]
    (ended,) = [event for event in FAILED if isinstance(event, RunEnded)]
    told = [
        AttemptEnded(
            float(k + 1), k, "a/0/0", number, 3, succeeded,
            None if succeeded else Reason("a/0/0/Lift", code, "it fell"),
        )
        for k, (number, code, succeeded) in enumerate(failures)
    ]  # fmt: skip
    last = replace(ended, t=99.0, reason=Reason("a/0/0/Lift", "LOST", "it fell"))
    (said, *_) = [text for text in explain([begun, *told, last]) if "attempt" in text] or [""]
    return [text for text in re.split(r" (?=At |So )", said) if text]


def test_failed_attempts_are_told_once_with_their_time_number_and_cause() -> None:
    assert attempts_of() == []
    first, second, third = attempts_of(
        (1, "SLIPPED", False), (2, "SLIPPED", False), (3, "LOST", False)
    )
    assert first.startswith("At 1.0 s attempt 1 of 3 (inner")
    assert first.endswith("Lift failed with SLIPPED: it fell.")
    assert second.endswith(" ended with SLIPPED, too.")
    assert third.startswith("At 3.0 s attempt 3 of 3 (inner")
    assert third.endswith(" ended with LOST, too.")  # as the run did
    assert attempts_of((1, "", True)) == []


def test_of_many_attempts_the_first_three_and_the_last_are_told() -> None:
    five = attempts_of(*[(k, "SLIPPED", False) for k in (1, 2, 3, 1, 2)])
    assert [text[:10] for text in five] == [
        "At 1.0 s a",
        "At 2.0 s a",
        "At 3.0 s a",
        "So it went",
        "At 5.0 s a",
    ]
    assert five[3] == "So it went on, 1 attempts more."
    four = attempts_of(*[(k, "SLIPPED", False) for k in (1, 2, 3, 1)])
    assert [text[:8] for text in four] == ["At 1.0 s", "At 2.0 s", "At 3.0 s", "At 4.0 s"]


@pytest.mark.parametrize(
    ("outcome", "words"),
    [("failure", "It failed after 12.0 s"), ("stopped", "It was stopped after 12.0 s"), ("error", "It ended in the safe")],
)  # fmt: skip
def test_an_outcome_has_its_words(outcome: str, words: str) -> None:
    events = [
        replace(event, outcome=outcome, time=12.0) if isinstance(event, RunEnded) else event
        for event in FAILED
    ]
    assert any(words in text for text in explain(events)), list(explain(events))
