"""Rich's console, filtered."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, NoReturn

from rich.color import ColorSystem
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from pomona.executive.terminal.output import HARMFUL, Filtered, visible


class Screen(Console):
    """Rich's console on the terminal, with a filter for everything that it shows.

    Texts are no markup unless a call enables it: `[red]` in a name is `[red]`.
    """

    def __init__(
        self, *, stderr: bool = False, quiet: bool = False, width: int | None = None
    ) -> None:
        super().__init__(stderr=stderr, quiet=quiet, width=width, markup=False, highlight=False)
        if os.environ.get("FORCE_COLOR") and not (os.environ.get("NO_COLOR") or self.is_terminal):
            self._color_system = ColorSystem.STANDARD

    @property
    def is_terminal(self) -> bool:
        """Whether lines can be drawn anew. `FORCE_COLOR`, which rich takes for a terminal, asks for colours alone: a
        notebook or a CI's log would keep every state of a run's moving picture."""
        try:
            return self.file.isatty()
        except ValueError:  # it is closed
            return False

    @property
    def is_behind(self) -> bool:
        """Whether the reader of the output has not yet taken everything."""
        return bool(getattr(self.file, "is_behind", False))

    @property
    def file(self) -> IO[str]:
        """Where it writes: the stream itself, not filtered a second time."""
        stream = super().file
        return stream.unfiltered if isinstance(stream, Filtered) else stream

    @file.setter
    def file(self, new_file: IO[str]) -> None:
        self._file = new_file

    def on_broken_pipe(self) -> NoReturn:
        """Raise BrokenPipeError when the reader has closed the pipe. Rich's method exits, but a run must end first."""
        raise BrokenPipeError(errno.EPIPE, "Broken pipe: the reader of the output has closed it")

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render as rich does, with terminal control characters made visible."""
        for segment in super().render(renderable, options):
            text, style, control = segment
            if control is None and (HARMFUL.search(text) or (style is not None and style.link)):
                yield Segment(visible(text), style.update_link(None) if style is not None else None)
            else:
                yield segment


@contextlib.contextmanager
def in_browser(console: Screen, link: str) -> Iterator[None]:
    """Open a page in the operator's browser; only from a terminal on this machine with a graphical display.

    The link holds the token that acts, and a command line is visible to other users: the browser gets a private file.
    """
    graphical = sys.platform in ("darwin", "win32") or bool(
        {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    )
    if not (console.is_terminal and graphical) or "SSH_CONNECTION" in os.environ:
        yield
        return
    import html  # a command without a page needs none of these
    import tempfile
    import webbrowser

    with tempfile.TemporaryDirectory(prefix="pomona_") as folder:
        page = Path(folder) / "open.html"
        page.write_text(
            f'<meta http-equiv="refresh" content="0; url={html.escape(link)}">', encoding="utf-8"
        )
        with contextlib.suppress(webbrowser.Error, OSError):  # the link is printed, too
            webbrowser.open(page.as_uri())
        yield
