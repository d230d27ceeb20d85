"""docs/architecture.md follows one tick: its events come in the order that it lists."""

from __future__ import annotations

import re
from pathlib import Path

from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running.events import (
    Event,
    LinkChanged,
    NodeChanged,
    PortWritten,
    RunEnded,
    StateChanged,
)

PAGE = (Path(__file__).parents[3] / "docs" / "architecture.md").read_text("utf-8")
EXAMPLE = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_example_has_the_events_that_are_listed() -> None:
    runner, _, events = make(EXAMPLE, Registry({"Turn": Turn}))
    runner.run()
    rows = re.findall(r"^\| `(\w+)` \| ([\w/]*) ?\| ([\w.]+) \|$", PAGE, re.MULTILINE)
    assert [row(event) for event in events] == rows


def row(event: Event) -> tuple[str, str, str]:
    """Kind, subject and value of an event, as the page lists them."""
    match event:
        case NodeChanged():
            about, value = event.path, event.status
        case PortWritten():
            about, value = event.key, str(event.value)
        case LinkChanged():
            about, value = event.device, event.state
        case StateChanged():
            about, value = "", event.state
        case RunEnded():
            about, value = "", event.outcome
        case _:
            about, value = "", ""
    return type(event).__name__, about, value
