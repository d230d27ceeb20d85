"""The editor's server: one file, any number of pages."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from pomona.executive.errors import UsageError
from pomona.executive.files import default_name, read_text
from pomona.executive.registry import Registry
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.yaml_nodes import MAX_CHARACTERS
from pomona.tools.dashboard import server as dashboard
from pomona.tools.dashboard.choices import cell_facts
from pomona.tools.dashboard.options import free_port
from pomona.tools.dashboard.security import Access, RequestGuard
from pomona.tools.dashboard.serving import HttpService, acting
from pomona.tools.scenarios.scenario import is_scenario
from pomona.tools.tree_editor.drafts import PAGE, Draft, Drafts
from pomona.tools.tree_editor.tree_file import EditedFile
from pomona.tools.tree_editor.trial import EditorTrial
from pomona.tools.tree_editor.workbench import Workbench, settings_of

STATIC = Path(__file__).parent / "static"
MOST_BODY = (
    8 * MAX_CHARACTERS
)  # of a request [byte]: a text has MAX_CHARACTERS, each up to six bytes in JSON
MOST_FILES = 200  # files below the tree's folder that are looked through for scenarios
PAGE_GONE = 5.0  # time without a request after which a page counts as closed [s]
REHEARSALS = ("dry", "run", "scenarios")
SIMULATED = (
    "simulated",
    "mock",
)  # kinds of cells on which the editor runs a tree; others move real devices

T = TypeVar("T")
Body = dict[str, Any]
Facts = dict[str, Any]


class TreeEditor:
    """Serves the page and its requests. Nothing is written to the file but by a request to save."""

    def __init__(
        self, file: EditedFile, access: Access, skills: Registry, cell: Path, records: Path
    ) -> None:
        """
        Args:
            file: the tree file.
            access: who may read and act.
            skills: those that are installed.
            cell: the simulated cell whose names are offered, and on which a run starts.
            records: folder of the records of runs.
        """
        self.file = file
        self.access = access
        self.cell = cell
        self.records = records
        self.drafts, self.trial = Drafts(file.path), EditorTrial()
        self.workbench = Workbench(file.path, skills, cell)
        self._pages: dict[str, float] = {}
        self.app = Starlette(
            routes=[
                Route("/", self._page),
                Route("/api/file", self._open),
                Route("/api/watch", self._watch),
                Route("/api/catalogue", self._catalogue),
                *(self._acting(name, answer) for name, answer in self._answers()),
                Mount("/static/shared", StaticFiles(directory=dashboard.STATIC)),
                Mount("/static", StaticFiles(directory=STATIC)),
            ],
            middleware=[Middleware(RequestGuard, access=access)],
        )
        self._service = HttpService(self.app, access, MOST_BODY)

    def start(self) -> None:
        """Serve in a thread of its own. Raises UsageError: it cannot listen there."""
        self._service.start()

    def close(self) -> None:
        """End a run and stop serving."""
        self.trial.close()
        self._service.close()

    # ------------------------------------------------------------------------------------------------ reading

    async def _page(self, _request: Request) -> Response:
        return HTMLResponse((STATIC / "index.html").read_text(encoding="utf-8"))

    async def _open(self, request: Request) -> Response:
        page = request.query_params.get("page", "")
        return JSONResponse(await asyncio.to_thread(self._opened, page))

    def _opened(self, page: str) -> Facts:
        gone = self._left(page)
        return {
            "name": self.file.path.name,
            "path": str(self.file.path),
            "link": str(self.file.given) if self.file.link else "",
            "may_act": self.access.may_act,
            "cell": self.cell.stem,
            "options": cell_facts(self.cell)["options"],
            "scenarios": [
                str(path.relative_to(self.file.path.parent)) for path in self._scenarios()
            ],
            "drafts": list(map(asdict, gone)),
            "disk": asdict(self.file.read()),
        }

    def _left(self, page: str) -> list[Draft]:
        """Return a page's own draft and those of closed pages, also of other processes."""
        if PAGE.fullmatch(page):
            self.drafts.note_open(page)
        return [
            draft
            for draft in self.drafts.all()
            if draft.page == page or not self._holds(draft.page)
        ]

    async def _watch(self, request: Request) -> Response:
        asked = request.query_params
        page = asked.get("page", "")
        self._pages[page[:40]] = time.monotonic()
        disk = await asyncio.to_thread(self.file.read)
        left = [draft.page for draft in await asyncio.to_thread(self._left, page)]
        facts: Facts = {
            "stamp": disk.stamp,
            "problem": disk.problem,
            "others": self._others(page),
            "drafts": left,
        }
        if disk.stamp != asked.get("stamp", ""):
            facts["disk"] = asdict(disk)
        trial = self.trial.since(_whole(asked.get("trial")), _whole(asked.get("count")))
        if not self.access.authorised(
            request.headers
        ):  # the link of a run's page lets its reader act there
            trial["messages"] = [message for message in trial["messages"] if "page" not in message]
        return JSONResponse(facts | trial)

    async def _catalogue(self, _request: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(self.workbench.catalogue))

    def _holds(self, page: str) -> bool:
        return self._is_open(page) or self.drafts.is_open(page, PAGE_GONE)

    def _is_open(self, page: str) -> bool:
        return time.monotonic() - self._pages.get(page, -PAGE_GONE) < PAGE_GONE

    def _others(self, page: str) -> int:
        return sum(self._is_open(other) for other in self._pages if other != page)

    def _scenarios(self) -> Iterator[Path]:
        """Yield the scenario files below the tree's folder that test it."""
        if not self.file.path.exists():
            return
        for path in sorted(self.file.path.parent.rglob("*.yaml"))[:MOST_FILES]:
            with contextlib.suppress(UsageError):
                text = read_text(path)
                if self.file.path.name in text and is_scenario(text):
                    yield path

    # ------------------------------------------------------------------------------------------------- acting

    def _answers(self) -> list[tuple[str, Callable[[Body], Facts]]]:
        """The requests that act, by name. Each is answered in a thread of its own."""
        bench = self.workbench
        return [
            ("state", lambda body: bench.state(_text(body))),
            ("edit", lambda body: bench.edit(_text(body), _value(body, "edit", dict))),
            ("mend", lambda body: bench.mend(_text(body), _value(body, "number", int))),
            (
                "offers",
                lambda body: {
                    "ports": bench.offers(
                        _text(body), _value(body, "definition", str), _value(body, "kind", str)
                    )
                },
            ),
            ("draft", self._keep_draft),
            ("drop", self._drop_draft),
            ("save", self._save),
            ("start", self._start),
            ("stop", self._stop),
        ]

    def _acting(self, name: str, answer: Callable[[Body], Facts]) -> Route:
        return acting(name, self.access, MOST_BODY, lambda body: asyncio.to_thread(answer, body))

    def _keep_draft(self, body: Body) -> Facts:
        try:
            self.drafts.keep(
                Draft(
                    _value(body, "page", str), _text(body), _value(body, "stamp", str), time.time()
                )
            )
        except OSError as error:
            raise UsageError(f"the draft is not kept: {error.strerror or error}") from error
        return {"kept": True}

    def _drop_draft(self, body: Body) -> Facts:
        self.drafts.drop(_value(body, "page", str))
        return {"kept": False}

    def _save(self, body: Body) -> Facts:
        disk = self.file.save(_text(body), _value(body, "stamp", str))
        self.drafts.drop(_value(body, "page", str))
        return {"disk": asdict(disk)}

    def _start(self, body: Body) -> Facts:
        """Begin a dry run, the scenarios, or a run on the simulated cell, of a text that has no errors."""
        kind = _value(body, "kind", str)
        text = _text(body)
        if kind not in REHEARSALS:
            raise UsageError(f"'{kind}' is none of {', '.join(REHEARSALS)}")
        errors = [
            found
            for found in self.workbench.state(text)["findings"]
            if found["severity"] == "error"
        ]
        if errors:
            line = errors[0]["line"]
            message = errors[0]["message"]
            where = (
                f"line {line}: " if line else ""
            )  # a finding of another file names its place itself
            raise UsageError(f"not started: {where}{message}; correct the errors first")
        refuse_real(self.cell)
        settings = settings_of(body.get("settings", {}))
        if kind == "run":
            self.workbench.refuse(text, settings, self.cell)
        scenarios = [str(path) for path in self._scenarios()] if kind == "scenarios" else []
        if kind == "scenarios" and not scenarios:
            raise UsageError(
                f"no scenario file below {self.file.path.parent} tests {self.file.path.name}"
            )
        order = {
            "kind": kind, "dry": kind == "dry", "tree": str(self.file.path), "text": text, "cell": str(self.cell),
            "seed": _value(body, "seed", int) if "seed" in body else 0, "settings": settings,
            "real_time": body.get("real_time") is True, "record": str(self.records), "port": free_port(),
            "scenarios": scenarios,
        }  # fmt: skip
        return {"trial": self.trial.start(order)}

    def _stop(self, _body: Body) -> Facts:
        self.trial.interrupt()
        return {"stopped": True}


def refuse_real(cell: Path) -> None:
    """Raise if a cell is not a simulated one. Raises UsageError: the editor moves no real device."""
    if (kind := cell_facts(cell)["kind"]) not in SIMULATED:
        raise UsageError(
            f"the cell '{cell.stem}' is {kind}: the editor runs trees on simulated cells only; use pomona run"
        )


def default_cell() -> Path:
    """Return the file of the default cell."""
    return installed_trees() / "cells" / f"{default_name('cell')}.yaml"


def _text(body: Body) -> str:
    text = body.get("text")
    if not isinstance(text, str):
        raise ValueError("'text' is a text")
    if len(text) > MAX_CHARACTERS:
        raise UsageError("the text is longer than 512 KiB, the most of a tree file")
    return text.replace("\r\n", "\n").replace("\r", "\n")


_KINDS = {str: "a text", int: "a whole number", dict: "an object"}


def _value(body: Body, key: str, kind: type[T]) -> T:
    """Return a value of a request; a missing text is empty. Raises ValueError: it is of another kind."""
    value = body.get(key, "")
    if type(value) is not kind:
        raise ValueError(f"'{key}' is {_KINDS[kind]}")
    return value


def _whole(said: str | None) -> int:
    return int(said) if said is not None and said.isdecimal() and len(said) < 10 else 0
