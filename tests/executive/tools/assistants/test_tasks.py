"""Tasks in English, carried out through the door: each answer leads to the next call."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.executive.tools.assistants.conftest import Assistant, Refused

pytestmark = pytest.mark.slow

TASKS = yaml.safe_load(Path(__file__).with_name("tasks.yaml").read_text("utf-8"))


def filled(value: Any, taken: dict[str, str]) -> Any:
    """Return a value with what earlier answers gave in place of `<name>`."""
    if isinstance(value, dict):
        return {filled(key, taken): filled(each, taken) for key, each in value.items()}
    if isinstance(value, list):
        return [filled(each, taken) for each in value]
    return (
        re.sub(r"<(\w+)>", lambda found: taken[found[1]], value)
        if isinstance(value, str)
        else value
    )


def answered(assistant: Assistant, call: dict[str, Any], taken: dict[str, str]) -> str:
    if "refused" not in call:
        return assistant.call(call["tool"], **filled(call.get("with", {}), taken))
    with pytest.raises(Refused) as refused:
        assistant.call(call["tool"], **filled(call.get("with", {}), taken))
    return str(refused.value)


@pytest.mark.parametrize("task", TASKS, ids=[task["task"][:50] for task in TASKS])
def test_a_task_is_carried_out_with_the_answers_of_its_own_calls(
    assistant: Assistant, task: dict[str, Any]
) -> None:
    taken: dict[str, str] = {}
    for call in task["calls"]:
        text = answered(assistant, call, taken)
        for words in (*call.get("expect", ()), *call.get("refused", ())):
            assert filled(words, taken) in text, (call, text)
        for name, pattern in call.get("take", {}).items():
            found = re.search(pattern, text)
            assert found is not None, (pattern, text)
            taken[name] = found[1]


def test_at_least_twenty_tasks_use_every_tool(assistant: Assistant) -> None:
    tools = assistant.listed()
    assert len(TASKS) >= 20
    assert {call["tool"] for task in TASKS for call in task["calls"] if "tool" in call} == set(
        tools
    )


def test_after_its_first_call_a_task_needs_only_names_that_an_earlier_answer_or_its_help_has_given(
    assistant: Assistant,
) -> None:
    helps = {tool.__name__: tool.__doc__ for tool in assistant.door.tools()}
    for task in TASKS:
        known = ""
        for number, call in enumerate(task["calls"]):
            used = re.findall(r"<(\w+)>", str(call))
            led = used or call["tool"] in known
            assert number == 0 or led, (task["task"], call)
            known += f" {call.get('tool', '')} {helps.get(call.get('tool', ''), '')}"
