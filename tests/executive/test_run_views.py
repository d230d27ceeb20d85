"""Views of a run are one class each, found by entry point."""

from __future__ import annotations

import argparse
import logging
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from pomona.executive import run_views
from pomona.executive.cli import main as pomona
from pomona.executive.errors import UsageError
from pomona.executive.run_views import GROUP, RunView, RunViews, ViewedRun
from pomona.executive.running.events import Event, RunEnded
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.executive.terminal.screen import Screen

TREE = "pomona: 1\ntree: rest\nroot:\n  wait: 1 ms\n"
CALLS: list[str] = []


class Counting(RunView):
    """A view that notes its calls."""

    name = "counting"

    def add(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(f"--{self.name}", action="store_true")

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if getattr(options, self.name):
            CALLS.append(f"{self.name} opens after {len(run.opened)}")
        return bool(getattr(options, self.name))

    def preparing(self, tree: str) -> Starting:
        CALLS.append(f"{self.name} prepares {tree}")
        return Starting()

    def on_ready(self, runner: Runner) -> None:
        CALLS.append(f"{self.name} is ready")

    def on_event(self, event: Event) -> None:
        if isinstance(event, RunEnded):
            CALLS.append(f"{self.name} sees {event.outcome}")

    def ended(self, problem: str) -> None:
        CALLS.append(f"{self.name} ended {problem}".strip())

    def close(self) -> None:
        CALLS.append(f"{self.name} closes")


class Second(Counting):
    """Another one."""

    name = "second"


class Failing(Counting):
    """A view whose event handler fails."""

    name = "failing"

    def on_event(self, event: Event) -> None:
        raise RuntimeError("the lamp is broken")


@pytest.fixture
def offered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Offer the views above, one that is no module, and no others."""
    names = {
        "b": f"{__name__}:Second",
        "a": f"{__name__}:Counting",
        "c": f"{__name__}:Failing",
        "d": "no_module:View",
    }
    points = [EntryPoint(name, value, GROUP) for name, value in names.items()]
    loaded = {"Second": Second, "Counting": Counting, "Failing": Failing}

    found = EntryPoint.load

    def load(point: EntryPoint) -> object:
        return loaded.get(point.attr) or found(point)

    monkeypatch.setattr(EntryPoint, "load", load)
    monkeypatch.setattr(run_views, "entry_points", lambda group: points if group == GROUP else [])
    CALLS.clear()


def run(tmp_path: Path, *options: str) -> int:
    tree = tmp_path / "rest.yaml"
    tree.write_text(TREE)
    return pomona(
        ["run", str(tree), "--dry", "--no-record", "--record", str(tmp_path), "--quiet", *options]
    )


@pytest.mark.usefixtures("offered")
def test_views_are_opened_by_name_follow_the_run_and_are_closed_in_reverse(tmp_path: Path) -> None:
    assert run(tmp_path, "--second", "--counting") == 0
    assert CALLS == [
        "counting opens after 0", "second opens after 1", "counting prepares rest", "second prepares rest",
        "counting is ready", "second is ready", "counting sees success", "second sees success",
        "counting ended", "second ended", "second closes", "counting closes",
    ]  # fmt: skip


@pytest.mark.usefixtures("offered")
def test_a_view_that_is_not_asked_for_gets_nothing(tmp_path: Path) -> None:
    assert run(tmp_path) == 0
    assert CALLS == []


@pytest.mark.usefixtures("offered")
def test_an_exception_of_a_view_ends_the_run_in_the_safe_state(tmp_path: Path) -> None:
    assert run(tmp_path, "--failing", "--counting") == 3
    assert "counting sees error" in CALLS
    assert CALLS[-2:] == ["failing closes", "counting closes"]


@pytest.mark.usefixtures("offered")
def test_a_view_that_cannot_be_imported_is_reported_and_left_out(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING):
        views = RunViews.installed()
    assert (
        "the view 'd' of no_module:View cannot be used: No module named 'no_module'" in caplog.text
    )
    views.add(argparse.ArgumentParser())


@pytest.mark.usefixtures("offered")
def test_views_learn_why_a_run_did_not_begin(tmp_path: Path) -> None:
    views, parser = RunViews.installed(), argparse.ArgumentParser()
    views.add(parser)
    opened = views.open(parser.parse_args(["--counting"]), Screen(quiet=True), tmp_path)
    with pytest.raises(UsageError), opened, views.run("rest"):
        raise UsageError("the cell is missing")
    assert CALLS[-2:] == ["counting ended the cell is missing", "counting closes"]
