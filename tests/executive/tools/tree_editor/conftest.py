"""An editor on a free port, and Chromium to work with it."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.registry import Registry
from pomona.tools.dashboard.security import Access
from pomona.tools.tree_editor.server import TreeEditor, default_cell
from pomona.tools.tree_editor.tree_file import EditedFile
from tests.executive.tools.dashboard.conftest import failures

SMALL = """# Look once.
pomona: 1
tree: small

root:
  sequence:               # in this order
    - wait: 1 s
    - set: {done: true}   # for later
    - check: "{done}"
"""


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree file; drafts are kept beside it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


@pytest.fixture
def make_editor(tree: Path) -> Iterator[Callable[[Path], TreeEditor]]:
    """Makes editors of files, which are closed after the test."""
    made = []

    def make(path: Path) -> TreeEditor:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        made.append(
            TreeEditor(
                EditedFile(path),
                Access("127.0.0.1", port),
                Registry.installed(),
                default_cell(),
                path.parent / "runs",
            )
        )
        return made[-1]

    yield make
    for editor in made:
        editor.close()


@pytest.fixture
def editor(make_editor: Callable[[Path], TreeEditor], tree: Path) -> TreeEditor:
    """An editor of the tree file."""
    return make_editor(tree)


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[..., Any]]:
    """Opens an editor's page; after the test none may have had an error or a failed request."""
    problems: list[str] = []
    contexts = []

    def open_one(editor: TreeEditor, **settings: Any) -> Any:
        if editor._service.server is None:
            editor.start()
        context = chromium.new_context(**{"viewport": {"width": 1280, "height": 800}, **settings})
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(60_000)
        page.on(
            "console", lambda said: problems.append(said.text) if said.type == "error" else None
        )
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("requestfailed", lambda request: problems.extend(failures(request)))
        page.goto(editor.access.link)
        page.wait_for_selector("body[data-ready=yes]")
        return page

    yield open_one
    for context in contexts:
        context.close()
    assert [problem for problem in problems if "409" not in problem] == []
