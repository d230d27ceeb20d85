"""Malicious requests: each is refused with one clear line, is logged, and has changed nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.executive.tools.assistants.conftest import LOOK, Assistant, Refused

pytestmark = pytest.mark.slow

TREE = "pomona: 1\ntree: t\nroot:\n  wait: 1 s\n"

MALICIOUS: dict[str, tuple[str, dict[str, Any], str]] = {
    "a path above the folder": ("read_file", {"path": "../secret.yaml"}, "outside the folder"),
    "an absolute path": ("read_file", {"path": "/etc/passwd"}, "outside the folder"),
    "a path of the user's home": ("read_file", {"path": "~/.ssh/id_rsa"}, "outside the folder"),
    "a link to a file outside": ("read_file", {"path": "link.yaml"}, "a link leads there"),
    "a file below a link to a folder outside": ("read_file", {"path": "up/secret.yaml"}, "a link leads there"),
    "a path with a zero byte": ("read_file", {"path": "look.yaml\0.txt"}, "no file name"),
    "a path of a million characters": ("read_file", {"path": "a" * 1_000_000}, "no file name"),
    "a check of a file outside": ("check", {"path": "up/secret.yaml"}, "a link leads there"),
    "a drawing of a file outside": ("show", {"tree": "../secret.yaml"}, "outside the folder"),
    "mocks outside": ("dry_run", {"tree": "look.yaml", "mocks": "../secret.yaml"}, "outside the folder"),
    "an option in the place of a file": ("check", {"path": "--fix"}, "outside the folder"),
    "an option in the place of a tree": ("run", {"tree": "--cell=lab"}, "outside the folder"),
    "a shell in the place of a tree": ("run", {"tree": "look.yaml; rm -rf ."}, "no file 'look.yaml; rm -rf .'"),
    "a shell in a setting's name": ("run", {"tree": "look.yaml", "settings": {"$(reboot)": "1"}}, "no setting has"),
    "lines in a setting's value": ("run", {"tree": "look.yaml", "settings": {"tries": "1\n--cell=lab"}}, "no setting"),
    "a hundred settings": ("run", {"tree": "look.yaml", "settings": {f"k{n}": "1" for n in range(99)}}, "30 settings"),
    "a seed that is an option": ("run", {"tree": "look.yaml", "seed": "1 --cell=lab"}, "integer"),
    "an argument that no tool has": ("run", {"tree": "look.yaml", "cleared": True}, "has no argument 'cleared'"),
    "a tool that does not exist": ("shell", {"command": "id"}, "Unknown tool"),
    "a real cell": ("run", {"tree": "look.yaml", "cell": "lab"}, "is real, not simulated"),
    "a real cell in the folder": ("run", {"tree": "look.yaml", "cell": "bench.yaml"}, "is real, not simulated"),
    "an emulated cell": ("run", {"tree": "look.yaml", "cell": "emulated"}, "is emulated, not simulated"),
    "recorded frames of another folder": ("run", {"tree": "look.yaml", "cell": "frames"}, "is frames, not simulated"),
    "a cell outside": ("run", {"tree": "look.yaml", "cell": "../cell.yaml"}, "outside the folder"),
    "a tree in the place of a cell": ("run", {"tree": "look.yaml", "cell": "look.yaml"}, "no cell file"),
    "an approval of itself": ("approve", {"tree": "look.yaml", "cell": "sim", "reason": "x"}, "is simulated"),
    "a request without a reason": ("approve", {"tree": "look.yaml", "cell": "bench.yaml", "reason": " "}, "a reason"),
    "a record of another folder": ("explain", {"run": "../../other/runs/x"}, "no record"),
    "a record by its path": ("explain", {"run": "/var/lib"}, "no record"),
    "evidence of other folders": ("evidence", {"runs": ["..", "/tmp"]}, "no record"),
    "evidence of a thousand records": ("evidence", {"runs": ["last"] * 1000}, "1 to 100"),
    "a file above the folder": ("write_file", {"path": "../t.yaml", "text": TREE}, "outside the folder"),
    "a file below a link": ("write_file", {"path": "up/t.yaml", "text": TREE}, "a link leads there"),
    "a file in the place of a link": ("write_file", {"path": "link.yaml", "text": TREE, "replace": True}, "a link"),
    "a file among the records": ("write_file", {"path": "runs/t.yaml", "text": TREE}, "no place for a tree"),
    "a hidden file": ("write_file", {"path": ".git/hooks.yaml", "text": TREE}, "no place for a tree"),
    "a program": ("write_file", {"path": "t.py", "text": TREE}, "end with .yaml"),
    "a cell file": ("write_file", {"path": "c.yaml", "text": "kind: simulated\ndevices: {}\n"}, "cell is not written"),
    "a text that is no tree": ("write_file", {"path": "t.yaml", "text": "a: 1\n"}, "no YAML of a known kind"),
    "a text of ten megabytes": ("write_file", {"path": "t.yaml", "text": TREE + "#" * 10_000_000}, "256 KiB"),
    "writing over a file that was not read": ("write_file", {"path": "look.yaml", "text": TREE}, "exists"),
    "a wrong type": ("write_file", {"path": ["a"], "text": {}}, "valid string"),
}  # fmt: skip


def content(folder: Path) -> dict[str, str]:
    files = (
        path for path in folder.parent.rglob("*") if path.is_file() and "runs" not in path.parts
    )
    return {str(path): path.read_text() for path in files}


@pytest.mark.parametrize("name", MALICIOUS)
def test_a_malicious_request_is_refused_with_one_line_and_logged(
    assistant: Assistant, name: str
) -> None:
    tool, arguments, why = MALICIOUS[name]
    before = content(assistant.folder)
    with pytest.raises(Refused) as refused:
        assistant.call(tool, **arguments)
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 1100
    assert content(assistant.folder) == before
    assert assistant.door.runs_started == 0
    logged = json.loads(
        (assistant.folder / "runs" / "assistants.jsonl").read_text().splitlines()[-1]
    )
    assert logged["asked"]["name"] == tool
    assert logged["refused"] == str(refused.value)
    assert len(json.dumps(logged)) < 10_000


def refused_by(call: Callable[[], str]) -> str:
    with pytest.raises(Refused) as refused:
        call()
    return str(refused.value)


def test_the_number_of_runs_is_limited(assistant: Assistant) -> None:
    for seed in range(3):
        assistant.call("run", tree="look.yaml", seed=seed)
    assert "the limit of 3 runs is reached" in refused_by(
        lambda: assistant.call("run", tree="look.yaml")
    )
    assert len(list((assistant.folder / "runs").glob("*/run.mcap"))) == 3


def test_the_number_of_open_requests_is_limited(assistant: Assistant) -> None:
    arguments = {"tree": "look.yaml", "cell": "bench.yaml", "reason": "again"}
    for number in range(20):
        place = assistant.folder / "runs" / "approvals" / f"{number:04d}_look"
        place.mkdir(parents=True)
        (place / "request.json").write_text("{}")
    assert "20 requests wait" in refused_by(lambda: assistant.call("approve", **arguments))


def test_the_number_of_files_is_limited(assistant: Assistant) -> None:
    for number in range(500):
        (assistant.folder / f"{number}.yaml").touch()
    assert "500 files already" in refused_by(
        lambda: assistant.call("write_file", path="new.yaml", text=TREE)
    )


def test_a_cell_file_whose_kind_stands_elsewhere_gives_none_of_its_words_away(
    assistant: Assistant,
) -> None:
    (assistant.folder.parent / "secret.yaml").write_text("kind: the password\n")
    assistant.call("write_file", path="t.yaml", text=f"{TREE}include: ../secret.yaml\n")
    assert "password" not in refused_by(
        lambda: assistant.call("run", tree="look.yaml", cell="t.yaml")
    )


def test_many_findings_and_long_drawings_are_cut(assistant: Assistant) -> None:
    nodes = "".join(f"    - Nothing{number}: {{}}\n" for number in range(150))
    assistant.call(
        "write_file", path="t.yaml", text=f"pomona: 1\ntree: t\nroot:\n  sequence:\n{nodes}"
    )
    found = json.loads(assistant.call("check", path="t.yaml"))
    said = found["errors"], len(found["findings"]), found["left out"]
    assert said == (150, 100, 51)  # one is a note about the cell
    nodes = "".join(
        f"    - MoveTo: {{pose: home}}\n      description: {'long ' * 40}\n" for _ in range(900)
    )
    assistant.call(
        "write_file", path="long.yaml", text=f"pomona: 1\ntree: t\nroot:\n  sequence:\n{nodes}"
    )
    assert assistant.call("show", tree="long.yaml").endswith("\n… cut after 60000 characters")


def test_a_scenario_whose_tree_is_outside_is_refused(assistant: Assistant) -> None:
    for tree in ("../secret.yaml", "link.yaml", str(assistant.folder.parent / "secret.yaml")):
        text = f"pomona: 1\ntree: {tree}\ncases:\n  - name: x\n"
        assistant.call("write_file", path="s.yaml", text=text, replace=True)
        assert "outside the folder" in refused_by(lambda: assistant.call("test", scenario="s.yaml"))


def test_a_tree_that_calls_a_file_outside_is_refused_without_its_content(
    assistant: Assistant,
) -> None:
    text = "pomona: 1\ntree: t\nroot:\n  other: {}\nsubtrees:\n  other: {file: ../secret.yaml}\n"
    assistant.call("write_file", path="t.yaml", text=text)
    answer = assistant.call("check", path="t.yaml")
    assert "lies outside the tree's folder" in answer
    assert "MoveTo" not in answer


def test_a_run_on_a_real_cell_is_ordered_as_a_simulated_one_only(assistant: Assistant) -> None:
    assistant.call("run", tree="look.yaml", cell="sim")
    assert assistant.commands.given[-1][2] == "--simulated"


def test_without_its_log_the_door_gives_no_answer(assistant: Assistant) -> None:
    log = assistant.folder / "runs" / "assistants.jsonl"
    log.unlink()
    log.mkdir()
    assert "no log, no answer" in refused_by(lambda: assistant.call("read_file", path="look.yaml"))
    assert (assistant.folder / "look.yaml").read_text() == LOOK
