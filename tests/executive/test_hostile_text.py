"""No text of a tree, a record or a name controls a terminal."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest
from recorded_events import HOSTILE, foreign, started, write

from pomona.executive.cli import main
from pomona.executive.reasons import Reason
from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    NodeChanged,
    OperatorActed,
    PortWritten,
    RunEnded,
    SafeStopped,
)
from pomona.executive.terminal.output import json_text, visible
from pomona.executive.terminal.screen import Screen

EVIL = "\x1b]0;owned\x07\x1b[2J\x1b[31m\u202eevil\u200b\x9b5n\r[red]x[/] \ud800"
ACTING = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
REASON = Reason("a/Plan", EVIL, EVIL, {EVIL: 1.0})
NODES = (
    {"path": "a", "parent": None, "name": EVIL, "type": "retry"},
    {"path": "a/Plan", "parent": "a", "name": EVIL},
)
RUN: tuple[Event, ...] = (
    started(tree=EVIL, cell=EVIL, settings={EVIL: EVIL}, nodes=NODES, versions={EVIL: EVIL}),
    NodeChanged(0.1, 1, "a/Plan", "RUNNING", EVIL, 1),
    NodeChanged(0.5, 25, "a/Plan", "FAILURE", EVIL, 1, REASON),
    AttemptEnded(0.5, 25, "a", 1, 2, False, REASON),
    PortWritten(0.6, 26, EVIL, 1, "a/Plan", EVIL, {}),
    OperatorActed(0.7, 27, EVIL, EVIL, EVIL),
    SafeStopped(0.8, 28, EVIL),
    RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, {EVIL: EVIL}),
)


def test_every_acting_character_becomes_a_sign_and_everything_else_stays() -> None:
    assert visible("a\x1b[2J\x07\u202eb\r\x7f\x9b\ud800") == "a␛[2J␇<U+202E>b␍␡<U+009B><U+D800>"
    assert visible("Äpfel 🍎 שלום\n\tx") == "Äpfel 🍎 שלום\n\tx"
    assert not ACTING.search(visible(EVIL))


def test_json_has_the_same_content_and_acts_no_more() -> None:
    value = {"name": EVIL.replace("\ud800", ""), "apple": "🍎"}
    assert json.loads(json_text(value)) == value
    assert not ACTING.search(json_text(value))
    assert "🍎" in json_text(value)


@pytest.mark.parametrize(
    "command",
    [
        ["runs", "list"], ["runs", "list", "--json"], ["runs", "show", "odd"], ["runs", "show", "odd", "--json"],
        ["runs", "compare", "odd", "other"], ["explain", "odd"], ["rerun", "odd"],
        ["why", "odd"],
        ["runs", "repair", "odd"], ["runs", "show", f"no{EVIL[:-1]}"],
    ],
)  # fmt: skip
def test_no_command_lets_a_record_act_in_a_terminal(
    command: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("runs/odd"), RUN)
    write(Path("runs/other"), RUN)
    assert main(command) in (0, 2)
    said = capsys.readouterr()
    assert said.out + said.err
    assert not ACTING.search(said.out + said.err)


def test_no_command_lets_a_tree_act_in_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    evil = r"\e]0;owned\a\e[2J\u202Eevil\r[red]"
    text = f'pomona: 1\ntree: t\nroot:\n  sequence:\n    - wait: 20 ms\n      name: "{evil}"\n    - "{evil}": {{}}\n'
    Path("bad.yaml").write_text(text)
    Path("good.yaml").write_text(text.rsplit("    - ", 1)[0])
    Path("\u202eevil.yaml").write_text(text)
    for command in (
        ["check", "bad.yaml"], ["check", "bad.yaml", "--json"], ["check", "\u202eevil.yaml"], ["show", "good.yaml"],
        ["run", "good.yaml", "--dry"], ["run", "good.yaml", "--dry", "--json"], ["run", "bad.yaml", "--dry"],
        ["explain"], ["run", f"nothing{EVIL[:-1]}"],
    ):  # fmt: skip
        main(command)
        said = capsys.readouterr()
        assert said.out + said.err, command
        assert not ACTING.search(said.out + said.err), command


def test_a_screen_keeps_its_own_colours_and_no_link_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("FORCE_COLOR", "1")
    shown = io.StringIO()
    screen = Screen(width=80)
    screen.file = shown
    screen.print(f"[link=http://evil.example]{EVIL}[/link]", style="red")
    screen.print("[link=http://evil.example]here[/link]", markup=True)
    said = shown.getvalue()
    assert said.startswith("\x1b[31m")
    assert "[link=" in said
    assert not ACTING.search(re.sub("\x1b\\[[0-9]*m", "", said))


# ----------------------------------------------------------------------------------------- whatever is written


@pytest.mark.parametrize("name", HOSTILE)
def test_whatever_events_say_no_command_ends_in_a_traceback(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    foreign(Path("runs/odd"), HOSTILE[name])
    foreign(Path("runs/more"), HOSTILE["half_character"], HOSTILE[name])
    for record in ("odd", "more"):
        for command in (
            ["runs", "list"], ["runs", "show", record], ["explain", record], ["rerun", record],
            ["why", record],
            ["runs", "compare", record, record], ["runs", "export", record, f"{record}.jsonl"],
            ["runs", "export", record, "--to", "frames"], ["runs", "repair", record],
        ):  # fmt: skip
            assert main(command) in (0, 1, 2)
            said = capsys.readouterr()
            assert said.out + said.err
            assert "Traceback" not in said.out + said.err
