"""A dashboard on a free port, and Chromium to look at it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from shown_runs import GATE, Show

from tests.executive.language.conftest import pick_apple

__all__ = ["pick_apple"]


@pytest.fixture
def show(tmp_path: Path) -> Iterator[Show]:
    """A served dashboard."""
    GATE.clear()
    show = Show(tmp_path)
    show.dashboard.start()
    yield show
    show.close()


def failures(request: Any) -> list[str]:
    """Return the failed requests, except those that the page itself left before the answer."""
    return [] if request.failure == "net::ERR_ABORTED" else [f"{request.url}: {request.failure}"]


@pytest.fixture
def open_page(chromium: Any, show: Show) -> Iterator[Callable[..., Any]]:
    """Opens the page; after the test, none of the pages may have had an error or a failed request."""
    problems: list[str] = []
    contexts = []

    def open_one(fragment: str = "", **settings: Any) -> Any:
        context = chromium.new_context(**settings)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(60_000)
        page.on(
            "console",
            lambda message: problems.append(message.text) if message.type == "error" else None,
        )
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("requestfailed", lambda request: problems.extend(failures(request)))
        page.goto(f"{show.dashboard.link}{fragment and '&' + fragment}")
        return page

    yield open_one
    assert problems == []
    for context in contexts:
        context.close()
