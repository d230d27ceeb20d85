"""executive/pomona/executive/terminal/screen.py: nothing is redrawn on a terminal that cannot redraw."""

from __future__ import annotations

import io
import sys
import webbrowser
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.terminal.screen import Screen, in_browser


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("stream", "drawn_anew"), [(Terminal, True), (io.StringIO, False)])
def test_colours_can_be_asked_for_without_a_terminal_and_a_moving_picture_cannot(
    monkeypatch: pytest.MonkeyPatch, stream: Any, drawn_anew: bool
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys, "stdout", out := stream())
    screen = Screen()
    assert screen.is_terminal is drawn_anew
    screen.print("red", style="red")
    assert "\x1b[31m" in out.getvalue()


def test_without_being_asked_a_file_gets_plain_text(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setattr(sys, "stdout", out := io.StringIO())
    Screen().print("red", style="red")
    assert out.getvalue() == "red\n"


@pytest.mark.parametrize(
    ("stream", "environment", "opens"),
    [
        (Terminal, {"DISPLAY": ":0"}, 1),
        (io.StringIO, {"DISPLAY": ":0"}, 0),
        (Terminal, {}, 0),
        (Terminal, {"DISPLAY": ":0", "SSH_CONNECTION": "a b"}, 0),
    ],
)
def test_the_browser_opens_from_a_graphical_terminal_and_its_command_line_has_no_token(
    monkeypatch: pytest.MonkeyPatch, stream: Any, environment: dict[str, str], opens: int
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SSH_CONNECTION"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys, "stdout", stream())
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    with in_browser(Screen(), "http://127.0.0.1:8420/#act=secret"):
        assert len(opened) == opens
        for address in opened:
            assert "secret" not in address
            page = Path(address.removeprefix("file://"))
            assert "url=http://127.0.0.1:8420/#act=secret" in page.read_text("utf-8")
            assert page.parent.stat().st_mode & 0o077 == 0
    assert not any(Path(address.removeprefix("file://")).exists() for address in opened)
