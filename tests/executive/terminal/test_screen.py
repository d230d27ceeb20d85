"""executive/pomona/executive/terminal/screen.py: nothing is redrawn on a terminal that cannot redraw."""

from __future__ import annotations

import io
import sys
from typing import Any

import pytest

from pomona.executive.terminal.screen import Screen


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
