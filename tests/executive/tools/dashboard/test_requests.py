"""An assistant's request on the page: the operator reads tree, difference and cell, and starts exactly that."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.errors import UsageError
from pomona.tools.dashboard.approvals import Approvals, request_facts
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard
from tests.executive.tools.dashboard.test_accessibility import ASK, AXE

TREE = "pomona: 1\ntree: look  # <b>bold</b>\nroot:\n  MoveTo: {pose: observe}\n"
CELL = "kind: real\ndevices: {}\n"


@pytest.fixture
def records(tmp_path: Path) -> Path:
    """A folder of records with one request."""
    folder, records = tmp_path / "trees", tmp_path
    folder.mkdir()
    (folder / "look.yaml").write_text(TREE)
    (folder / "bench.yaml").write_text(CELL)
    asked = Approvals(folder.resolve(), records.resolve())
    assert (
        asked.ask("./look.yaml", "./bench.yaml", 4, {"tries": "3"}, "home first", 7) == "0001_look"
    )
    return records


def launcher(records: Path) -> Launcher:
    choices = Choices({"other": Path("other.yaml")}, {"sim": Path("sim.yaml")})
    return Launcher(Dashboard(Access("127.0.0.1", 0), records), records, choices)


def test_a_request_starts_with_its_own_tree_cell_seed_and_settings_whatever_the_form_has(
    records: Path,
) -> None:
    starts = launcher(records)
    (shown,) = request_facts(records)
    form = {
        "request": "0001_look",
        "version": shown["version"],
        "tree": "other",
        "cell": "sim",
        "seed": 9,
        "settings": {},
    }
    order = starts._order(form)
    assert order.tree == records / "approvals" / "0001_look" / "tree" / "look.yaml"
    assert order.cell == records / "trees" / "bench.yaml"
    assert (order.seed, order.settings, order.record, order.attended) == (
        4,
        {"tries": "3"},
        records,
        True,
    )


def test_a_request_that_is_not_the_one_on_the_page_is_not_started(records: Path) -> None:
    starts = launcher(records)
    (shown,) = request_facts(records)
    form = {"request": "0001_look", "version": shown["version"]}
    (records / "approvals" / "0001_look" / "tree" / "look.yaml").write_text(
        TREE.replace("observe", "home")
    )
    with pytest.raises(UsageError, match="the request 0001_look has changed: read it again"):
        starts._order(form)
    for name in ("../0001_look", "0002_look", 3, None):
        with pytest.raises(UsageError, match="there is no such request"):
            starts._order({**form, "request": name})


def test_a_request_whose_weights_have_changed_is_not_started(records: Path) -> None:
    (records / "trees" / "bench.yaml").write_text(f"{CELL}# eyes: bench.weights\n")
    weights = records / "trees" / "bench.weights"
    weights.write_bytes(b"\x00one")
    (shown,) = request_facts(records)
    form = {"request": "0001_look", "version": shown["version"]}
    assert launcher(records)._order(form)
    weights.write_bytes(b"\x00two")
    with pytest.raises(UsageError, match="has changed: read it again"):
        launcher(records)._order(form)


def test_a_request_that_names_an_unreadable_file_is_shown_with_its_problem(
    records: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (records / "trees" / "bench.yaml").write_text(f"{CELL}# eyes: bench.weights\n")
    weights = records / "trees" / "bench.weights"
    weights.write_bytes(b"one")
    read = Path.read_bytes

    def read_bytes(path: Path) -> bytes:
        if path.name == weights.name:
            raise PermissionError(13, "Permission denied", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    (shown,) = request_facts(records)
    assert "no request" in shown["problem"]
    assert "bench.weights" in shown["problem"]


def test_a_damaged_request_is_shown_with_its_problem_and_not_started(records: Path) -> None:
    starts = launcher(records)
    about = records / "approvals" / "0001_look" / "request.json"
    for damage in ({"tree": "../../../trees/look.yaml"}, {"settings": []}, {"seed": "x"}):
        kept = about.read_text()
        about.write_text(json.dumps({**json.loads(kept), **damage}))
        (shown,) = request_facts(records)
        assert "no request" in shown["problem"]
        with pytest.raises(UsageError, match="no request"):
            starts._order({"request": "0001_look", "version": ""})
        about.write_text(kept)


def test_a_folder_without_records_has_no_requests(tmp_path: Path) -> None:
    assert request_facts(tmp_path / "none") == []


@pytest.mark.slow
@pytest.mark.browser
def test_the_operator_reads_and_starts_a_request(
    show: Any, open_page: Callable[..., Any], records: Path
) -> None:
    from playwright.sync_api import expect

    started: list[dict[str, Any]] = []

    def start(form: dict[str, Any]) -> str:
        started.append(form)
        return "look"

    show.dashboard.allow_starts(start, Choices({}, {}))
    page = open_page()
    page.locator("#show-runs").click()
    page.get_by_text("0001_look: look on a REAL cell").click()
    request = page.locator("#requests")
    expect(request).to_contain_text("home first")
    expect(request).to_contain_text("seed 4 · tries = 3")
    expect(request.locator("pre").first).to_contain_text("+  MoveTo: {pose: observe}")
    expect(request.locator("pre").last).to_have_text(TREE)
    button = request.get_by_role("button", name="Start 0001_look")
    expect(button).to_be_disabled()
    page.evaluate(AXE.read_text(encoding="utf-8"))
    assert page.evaluate(ASK.replace("document", "'#requests'")) == []
    page.locator("#who").fill("ada")
    page.get_by_role("button", name="Take control").first.click()
    expect(button).to_be_enabled()
    button.click()
    expect(page.locator("#connection")).to_have_text("connected")
    (form,) = started
    assert form["request"] == "0001_look"
    assert form["version"] == request_facts(records)[0]["version"]
