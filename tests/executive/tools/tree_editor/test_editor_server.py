"""Every request of the editor's page, and requests that no page makes."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from pomona.executive.errors import UsageError
from pomona.tools.tree_editor import trial as trial_module
from pomona.tools.tree_editor.server import MOST_BODY, TreeEditor, refuse_real
from tests.executive.tools.tree_editor.conftest import SMALL

ACTING = ("state", "edit", "mend", "offers", "draft", "drop", "save", "start", "stop")
BROKEN = SMALL.replace("wait: 1 s", "wait: 1 kg")

Ask = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def client(editor: TreeEditor) -> TestClient:
    return TestClient(editor.app, base_url=f"http://127.0.0.1:{editor.access.port}")


@pytest.fixture
def ask(editor: TreeEditor, client: TestClient) -> Ask:
    def post(name: str, **body: Any) -> tuple[int, dict[str, Any]]:
        answer = client.post(
            f"/api/{name}", json=body, headers={"x-pomona-token": editor.access.token}
        )
        return answer.status_code, answer.json()

    return post


def opened(client: TestClient, page: str = "me") -> dict[str, Any]:
    return dict(client.get("/api/file", params={"page": page}).json())


# ------------------------------------------------------------------------------------------------- access


@pytest.mark.parametrize("name", ACTING)
def test_nothing_acts_without_the_token(client: TestClient, name: str) -> None:
    assert client.post(f"/api/{name}", json={"text": SMALL}).status_code == 403


@pytest.mark.parametrize("name", ACTING)
def test_a_page_of_another_site_is_refused(
    client: TestClient, editor: TreeEditor, name: str
) -> None:
    headers = {"x-pomona-token": editor.access.token, "origin": "http://evil.example"}
    assert client.post(f"/api/{name}", json={"text": SMALL}, headers=headers).status_code == 403
    headers = {"x-pomona-token": editor.access.token, "host": "evil.example"}
    assert client.post(f"/api/{name}", json={"text": SMALL}, headers=headers).status_code == 403


@pytest.mark.parametrize("path", ["/", "/api/file", "/api/watch", "/api/catalogue"])
def test_what_is_read_has_the_protective_headers(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == 200
    assert "default-src 'self'" in answer.headers["content-security-policy"]


@pytest.mark.parametrize(
    "path", ["/static/editor.js", "/static/editor.css", "/static/shared/dom.js"]
)
def test_the_pages_files_are_served(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 200


@pytest.mark.parametrize(
    "path", ["/static/../server.py", "/static/%2e%2e/server.py", "/api/nothing"]
)
def test_nothing_else_is_served(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


@pytest.mark.parametrize("name", ACTING)
@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{", b'{"text": 5}', b'{"text": null}', b"NaN", b'{"page": "../x"}']
)
def test_a_request_that_no_page_makes_is_refused_with_a_reason(
    client: TestClient, editor: TreeEditor, name: str, body: bytes, tree: Path
) -> None:
    if name == "stop" and body.startswith(b'{"'):
        return  # it needs no values
    headers = {"x-pomona-token": editor.access.token, "content-type": "application/json"}
    answer = client.post(f"/api/{name}", content=body, headers=headers)
    assert answer.status_code in (400, 409)
    assert answer.json()["error"]
    assert tree.read_text() == SMALL


def test_a_request_without_its_type_or_with_too_much_is_refused(
    client: TestClient, editor: TreeEditor
) -> None:
    headers = {"x-pomona-token": editor.access.token}
    assert client.post("/api/state", content=b"{}", headers=headers).status_code == 415
    headers["content-type"] = "application/json"
    assert (
        client.post("/api/state", content=b" " * (MOST_BODY + 1), headers=headers).status_code
        == 413
    )


def test_a_text_longer_than_a_tree_file_is_refused(ask: Ask) -> None:
    status, answer = ask("save", text="#" * 600_000, stamp="", page="me")
    assert status == 409
    assert "512 KiB" in answer["error"]


# ------------------------------------------------------------------------------------------------- the text


def test_the_state_of_a_text_has_nodes_and_findings_with_their_lines(ask: Ask) -> None:
    status, state = ask("state", text=BROKEN)
    assert status == 200
    assert [node["id"] for node in state["nodes"]] == ["root", "root/0", "root/1", "root/2"]
    found = [(found["line"], found["severity"]) for found in state["findings"]]
    assert found == [(7, "error"), (0, "note")]  # the note is of the cell


def test_parameters_have_their_units_and_range(ask: Ask) -> None:
    text = "pomona: 1\ntree: a\nparameters:\n  far: {type: length, default: 1 cm, max: 1 m}\nroot: {wait: 1 s}\n"
    (far,) = ask("state", text=text)[1]["parameters"]
    assert (far["default"], far["min"], far["max"], far["line"]) == ("1 cm", "", "1 m", 4)
    assert "mm" in far["units"]


def test_a_text_that_is_no_yaml_has_a_problem_and_no_nodes(ask: Ask) -> None:
    _, state = ask("state", text="root: [")
    assert state["nodes"] == []
    assert state["problem"]


def test_an_edit_changes_its_line_alone(ask: Ask) -> None:
    status, answer = ask(
        "edit",
        text=SMALL,
        edit={"do": "set_port", "node": "root/0", "port": "wait", "value": "2 s"},
    )
    assert status == 200
    assert answer["text"] == SMALL.replace("wait: 1 s", "wait: 2 s")
    assert answer["nodes"][1]["ports"][0]["text"] == "2 s"


@pytest.mark.parametrize(
    "edit",
    [
        {},
        {"do": "fly"},
        {"do": "delete"},
        {"do": "delete", "node": "root/9"},
        {"do": "delete", "node": 3},
    ],
)
def test_an_edit_that_cannot_be_made_is_refused_with_its_reason(
    ask: Ask, edit: dict[str, Any]
) -> None:
    status, answer = ask("edit", text=SMALL, edit=edit)
    assert status == 409
    assert answer["error"]


def test_the_first_node_of_an_empty_file_makes_a_tree(ask: Ask) -> None:
    _, answer = ask(
        "edit", text="", edit={"do": "insert", "into": "", "index": 0, "node": "sequence: []"}
    )
    assert answer["text"] == "pomona: 1\ntree: small\n\nroot:\n  sequence: []\n"


def test_a_hint_is_applied_once(ask: Ask) -> None:
    text = SMALL.replace("sequence:", "sequnce:")
    _, state = ask("state", text=text)
    (number,) = [found["number"] for found in state["findings"] if found["mends"]]
    _, answer = ask("mend", text=text, number=number)
    assert answer["text"] == SMALL
    assert ask("mend", text=SMALL, number=0)[0] == 409
    assert ask("mend", text=SMALL, number=True)[0] == 400


def test_wires_are_offered_by_type(ask: Ask) -> None:
    text = (
        "pomona: 1\ntree: a\nparameters:\n  far: {type: length, default: 1 cm}\n  who: {type: text, default: x}\n"
        'root:\n  sequence:\n    - Detect: {fruit: apple, detection: "{found}"}\n    - Refine: {}\n'
    )
    _, answer = ask("offers", text=text, definition="", kind="Refine")
    assert [offer["word"] for offer in answer["ports"]["detection"]] == ["{found}"]
    _, answer = ask("offers", text=text, definition="", kind="Detect")
    assert "{who}" in [offer["word"] for offer in answer["ports"]["fruit"]]
    assert "{far}" not in [offer["word"] for offer in answer["ports"]["fruit"]]


def test_the_catalogue_has_help_ports_and_failure_codes_of_every_skill_and_word(
    client: TestClient, editor: TreeEditor
) -> None:
    found = client.get("/api/catalogue").json()
    skills = editor.workbench._skills
    assert set(found["skills"]) == set(skills)
    for name, skill in found["skills"].items():
        assert skill["summary"]
        assert [port["name"] for port in skill["inputs"]] == list(skills[name].inputs)
        assert [one["code"] for one in skill["failures"]] == list(skills[name].failures)
        assert all(one["meaning"] for one in skill["failures"])
    assert {"sequence", "retry", "check", "timeout"} <= set(found["words"])
    assert all(word["summary"] for word in found["words"].values())
    speeds = [
        port
        for skill in found["skills"].values()
        for port in skill["inputs"]
        if port["type"] == "length"
    ]
    assert all("mm" in port["units"] for port in speeds)
    pose = next(port for port in found["skills"]["MoveTo"]["inputs"] if port["name"] == "pose")
    assert "observe" in pose["choices"]


# ------------------------------------------------------------------------------------------------- the file


def test_a_save_writes_the_text_and_drops_the_draft(
    ask: Ask, client: TestClient, tree: Path
) -> None:
    stamp = opened(client)["disk"]["stamp"]
    ask("draft", page="me", text=BROKEN, stamp=stamp)
    status, answer = ask("save", page="me", text=BROKEN, stamp=stamp)
    assert (status, tree.read_text()) == (200, BROKEN)
    assert answer["disk"]["stamp"] != stamp
    assert opened(client)["drafts"] == []


def test_nothing_is_written_before_a_save(ask: Ask, tree: Path) -> None:
    for name, more in (
        ("state", {}),
        ("draft", {"stamp": ""}),
        ("edit", {"edit": {"do": "delete", "node": "root/0"}}),
    ):
        assert ask(name, text=BROKEN, page="me", **more)[0] == 200
    assert tree.read_text() == SMALL
    assert [path.name for path in tree.parent.iterdir() if path.name != "cache"] == ["small.yaml"]


def test_a_save_over_another_programs_change_is_a_conflict_with_its_content(
    ask: Ask, client: TestClient, tree: Path
) -> None:
    stamp = opened(client)["disk"]["stamp"]
    tree.write_text("pomona: 1\n")
    status, answer = ask("save", page="me", text=BROKEN, stamp=stamp)
    assert (status, answer["disk"]["text"], tree.read_text()) == (409, "pomona: 1\n", "pomona: 1\n")
    assert ask("save", page="me", text=BROKEN, stamp=answer["disk"]["stamp"])[0] == 200


def test_a_watching_page_gets_the_content_only_after_a_change(
    client: TestClient, tree: Path
) -> None:
    stamp = opened(client)["disk"]["stamp"]
    asked = {"page": "me", "stamp": stamp, "trial": "x", "count": "-1"}
    assert "disk" not in client.get("/api/watch", params=asked).json()
    tree.write_text("pomona: 1\n")
    assert client.get("/api/watch", params=asked).json()["disk"]["text"] == "pomona: 1\n"


def test_pages_of_one_file_are_counted(client: TestClient) -> None:
    assert client.get("/api/watch", params={"page": "me"}).json()["others"] == 0
    assert client.get("/api/watch", params={"page": "you"}).json()["others"] == 1


def test_the_draft_of_a_closed_page_is_found_and_that_of_an_open_one_is_not(
    ask: Ask, client: TestClient, tree: Path
) -> None:
    ask("draft", page="closed", text=BROKEN, stamp="s")
    (seen,) = tree.parent.rglob("*.open")
    os.utime(seen, (0.0, 0.0))
    ask("draft", page="open", text="other", stamp="s")
    client.get("/api/watch", params={"page": "open"})
    assert [(draft["page"], draft["text"]) for draft in opened(client)["drafts"]] == [
        ("closed", BROKEN)
    ]
    ask("drop", page="closed")
    assert opened(client)["drafts"] == []


def test_the_draft_of_a_page_that_another_process_shows_is_not_offered(
    ask: Ask, client: TestClient, make_editor: Callable[[Path], TreeEditor], tree: Path
) -> None:
    ask("draft", page="mine", text=BROKEN, stamp="s")
    other = make_editor(tree)
    assert other._opened("theirs")["drafts"] == []
    (seen,) = tree.parent.rglob("*.open")
    os.utime(seen, (0.0, 0.0))
    assert [draft["page"] for draft in other._opened("theirs")["drafts"]] == ["mine"]


# ------------------------------------------------------------------------------------------------- trials


def follow(editor: TreeEditor) -> list[dict[str, Any]]:
    """Wait for the end of the trial; return its messages."""
    thread = editor.trial._thread
    assert thread is not None
    thread.join(120)
    assert not thread.is_alive()
    return list(editor.trial.since(0, 0)["messages"])


def test_a_tree_with_an_error_is_not_started(ask: Ask, editor: TreeEditor) -> None:
    for kind in ("dry", "run", "scenarios"):
        status, answer = ask("start", kind=kind, text=BROKEN)
        assert status == 409
        assert "line 7" in answer["error"]
    assert editor.trial.since(0, 0) == {"trial": 0, "count": 0, "messages": []}


def test_an_unknown_trial_and_wrong_settings_are_refused(ask: Ask) -> None:
    assert ask("start", kind="fly", text=SMALL)[0] == 409
    assert ask("start", kind="dry", text=SMALL, settings=[1])[0] == 409
    assert ask("start", kind="dry", text=SMALL, seed="x")[0] == 400
    assert ask("start", kind="scenarios", text=SMALL)[0] == 409  # none tests this tree


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"tries": "9"}, "tries is at most 5, 9 is above"),
        ({"place": "99"}, "place"),
        ({"mass": "3 mm"}, "mass"),
        ({"plaec": "1"}, "did you mean 'place'?"),
    ],
)
def test_a_value_that_the_tree_or_the_cell_cannot_use_is_refused_before_the_run(
    ask: Ask, editor: TreeEditor, settings: dict[str, str], problem: str
) -> None:
    text = SMALL.replace(
        "root:", "parameters: {tries: {type: int, default: 1, max: 5}}\nroot:"
    ).replace("1 s\n", "1 s\n      retry: '{tries}'\n", 1)
    status, answer = ask("start", kind="run", text=text, settings=settings)
    assert status == 409
    assert problem in answer["error"]
    assert editor.trial.since(0, 0)["trial"] == 0


def test_a_real_cell_is_refused(ask: Ask, editor: TreeEditor) -> None:
    editor.cell = editor.cell.with_name("lab.yaml")
    status, answer = ask("start", kind="run", text=SMALL)
    assert status == 409
    assert "simulated cells only" in answer["error"]


def test_a_cell_file_that_cannot_be_read_is_named_with_the_reason(tree: Path) -> None:
    cell = tree.with_name("broken_cell.yaml")
    cell.write_text("cell: [1, 2\n")
    with pytest.raises(UsageError, match=r"broken_cell\.yaml:1:\d+: ") as refused:
        refuse_real(cell)
    assert "simulated cells only" not in str(refused.value)


@pytest.mark.slow
def test_a_dry_run_of_the_unsaved_text_reports_the_state_of_each_node(
    ask: Ask, editor: TreeEditor, tree: Path
) -> None:
    text = SMALL.replace('check: "{done}"', 'check: "not {done}"')
    assert ask("start", kind="dry", text=text)[0] == 200
    messages = follow(editor)
    lines = {
        node["path"]: node["line"] for message in messages for node in message.get("nodes", ())
    }
    ends = {lines[m["path"]]: m["status"] for m in messages if "path" in m}
    assert ends == {6: "FAILURE", 7: "SUCCESS", 8: "SUCCESS", 9: "FAILURE"}
    assert [m["outcome"] for m in messages if "outcome" in m] == ["failure"]
    assert tree.read_text() == SMALL


@pytest.mark.slow
def test_scenarios_beside_the_tree_are_run_on_the_unsaved_text(
    ask: Ask, editor: TreeEditor, tree: Path
) -> None:
    (tree.parent / "small_test.yaml").write_text(
        "pomona: 1\ntree: small.yaml\ncases:\n  - {name: succeeds, expect: success}\n"
        "  - {name: fails, expect: {status: failure, code: CONDITION_FALSE}}\n"
    )
    assert ask("start", kind="scenarios", text=SMALL.replace("{done}", "not {done}"))[0] == 200
    messages = follow(editor)
    assert {m["case"]: m["passed"] for m in messages if "case" in m} == {
        "succeeds": False,
        "fails": True,
    }
    assert {m["status"] for m in messages if "path" in m} == {"reached"}


@pytest.mark.slow
def test_a_trial_is_stopped_in_the_safe_state(
    ask: Ask, client: TestClient, editor: TreeEditor
) -> None:
    assert ask("start", kind="dry", text=SMALL.replace("1 s", "1000 s"), real_time=True)[0] == 200
    while "RUNNING" not in client.get("/api/watch", params={"page": "me"}).text:
        assert editor.trial._process is not None
        assert editor.trial._process.poll() is None
    assert ask("stop", page="me")[0] == 200
    assert [m["outcome"] for m in follow(editor) if "outcome" in m] == ["stopped"]


def test_a_reader_without_the_token_gets_no_link_that_acts(
    client: TestClient, editor: TreeEditor
) -> None:
    editor.trial._messages = [{"page": "http://127.0.0.1:1/#token=secret"}, {"outcome": "success"}]
    assert "secret" not in client.get("/api/watch", params={"page": "me"}).text
    acting = client.get(
        "/api/watch", params={"page": "me"}, headers={"x-pomona-token": editor.access.token}
    )
    assert "secret" in acting.text


def test_a_child_that_dies_is_reported(editor: TreeEditor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial_module.sys, "executable", "/bin/false")
    editor.trial.start({"kind": "dry"})
    assert follow(editor)[-1] == {"over": True, "problem": "it ended with status 1: "}


def test_a_command_for_a_file_that_is_no_tree_ends_with_one_line(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pomona.executive.cli import main

    tree.write_text("kind: simulated\n")
    for name in (str(tree), str(tree.parent), "no_such_tree"):
        assert main(["edit", name]) == 2
        error = capsys.readouterr().err.strip()
        assert error
        assert len(error.splitlines()) == 1, error
    assert json.dumps(tree.read_text()) == '"kind: simulated\\n"'
