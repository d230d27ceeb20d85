"""Beside the page: the editor of an offered tree, and the search for the cure of a failed simulated run."""

from __future__ import annotations

import http.client
import json
import urllib.request
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from shown_runs import GATE, HOLD, Show

from pomona.executive.cli import main
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.tools.dashboard.choices import Choices
from tests.executive.tools.dashboard.test_accessibility import ASK, AXE

TREE = """\
pomona: 1
tree: slow
root:
  wait: 4 s          # the work
  name: Work
  timeout: 1 s
"""


@pytest.fixture
def tree(tmp_path: Path, show: Show, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An offered tree; drafts are kept beside it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "trees").mkdir()
    path = tmp_path / "trees" / "slow.yaml"
    path.write_text(TREE)
    show.dashboard.allow_starts(lambda _form: "", Choices({"slow": path}, {}))
    return path


@pytest.fixture
def failed(tree: Path, tmp_path: Path) -> str:
    """A failed run of the tree on mocks."""
    assert main(["run", str(tree), "--dry", "--record", str(tmp_path)]) == 1
    return next(path.parent.name for path in tmp_path.glob(f"*/{EVENTS_FILE}"))


def ask(
    show: Show, path: str, body: dict[str, Any] | None = None, token: str | None = None
) -> tuple[int, Any]:
    """Post a body, or read without one; return status and answer."""
    access = show.dashboard.access
    line = http.client.HTTPConnection("127.0.0.1", access.port, timeout=60.0)
    headers = {
        "content-type": "application/json",
        "x-pomona-token": access.token if token is None else token,
    }
    line.request("GET" if body is None else "POST", path, body and json.dumps(body), headers)
    answer = line.getresponse()
    found = answer.status, json.loads(answer.read())
    line.close()
    return found


@pytest.mark.slow
def test_the_editor_of_an_offered_tree_is_served_and_ends_with_the_page(
    show: Show, tree: Path
) -> None:
    status, answer = ask(show, "/api/edit", {"tree": "slow"})
    assert status == 200, answer
    assert ask(show, "/api/edit", {"tree": "slow", "path": str(tree)}) == (200, answer)
    address = answer["link"].partition("#")[0]
    with urllib.request.urlopen(f"{address}api/file?page=x", timeout=30.0) as opened:
        assert json.load(opened)["path"] == str(tree)
    show.dashboard.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(address, timeout=30.0)


def test_no_other_file_is_edited_and_none_without_the_token(show: Show, tree: Path) -> None:
    assert ask(show, "/api/edit", {"tree": "slow"}, token="")[0] == 403
    for body in ({"tree": "../slow"}, {"tree": str(tree)}, {"tree": 3}, {}):
        status, answer = ask(show, "/api/edit", body or {"x": 1})
        assert (status, answer["error"]) == (
            409,
            "this dashboard offers no such tree; it offers slow",
        )
    status, answer = ask(show, "/api/edit", {"tree": "slow", "path": "/elsewhere/slow.yaml"})
    assert (status, answer["error"]) == (
        409,
        "type on the computer where the file is: pomona edit /elsewhere/slow.yaml",
    )


def test_no_cure_is_searched_without_token_record_or_rest(show: Show, failed: str) -> None:
    assert ask(show, "/api/why", {"run": failed}, token="")[0] == 403
    assert ask(show, "/api/why", {"run": "../x"}) == (409, {"error": "there is no such record"})
    show.run(HOLD)
    status, answer = ask(show, "/api/why", {"run": failed})
    assert (status, answer["error"]) == (409, "a run is going on: search when it has ended")
    GATE.set()
    assert ask(show, "/api/why") == (200, {})


def test_the_cure_of_a_real_run_is_a_command_to_type(
    show: Show, failed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (found,) = show.dashboard._index.read()
    monkeypatch.setattr(show.dashboard._index, "read", lambda: [replace(found, cell_kind="real")])
    status, answer = ask(show, "/api/why", {"run": failed})
    assert (status, answer["error"]) == (
        409,
        f"the run was on a cell that is real: type pomona why {failed}",
    )


def test_a_search_is_stopped_and_ends_with_the_page(show: Show, failed: str) -> None:
    assert ask(show, "/api/why", {"run": failed}) == (200, {"run": failed})
    assert ask(show, "/api/why")[1]["over"] is False
    assert ask(show, "/api/why", {"stop": True})[0] == 200
    _, found = ask(show, "/api/why")
    assert (found["run"], found["over"], found["answer"]) == (failed, True, None)


@pytest.mark.slow
@pytest.mark.browser
def test_a_failed_simulated_run_is_cured_from_the_page(
    show: Show, open_page: Any, failed: str
) -> None:
    from playwright.sync_api import expect

    page = open_page(f"run={failed}")
    cure = page.locator("#cure")
    page.get_by_role("button", name="Why did it fail?").click()
    expect(cure.get_by_role("button", name="Stop")).to_be_visible()
    expect(cure.locator("tbody tr").first).to_contain_text("timeout", timeout=240_000)
    expect(cure.locator("tbody tr").first).to_contain_text("6 of 6")
    page.evaluate(AXE.read_text(encoding="utf-8"))
    assert page.evaluate(ASK.replace("document", "'#why-bar'")) == []


@pytest.mark.slow
@pytest.mark.browser
def test_the_tree_of_a_run_is_edited_from_the_page(show: Show, open_page: Any, failed: str) -> None:
    from playwright.sync_api import expect

    page = open_page(f"run={failed}")
    with page.context.expect_page() as opened:
        page.locator("#edit-tree").click()
    expect(opened.value.locator("#name")).to_have_text("slow.yaml")
    expect(opened.value.locator("#saved")).to_have_text("saved")
    page.locator("#show-runs").click()
    with page.context.expect_page() as opened:
        page.locator("#start-edit").click()
    expect(opened.value.locator("#name")).to_have_text("slow.yaml")
