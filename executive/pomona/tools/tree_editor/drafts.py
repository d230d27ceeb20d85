"""Unsaved texts, kept in the user's cache: a closed browser or a lost computer loses nothing."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from pomona.executive.recording.plain_file import replace_file

MOST_DRAFTS = 20  # of one file; the oldest are removed
PAGE = re.compile(r"[A-Za-z0-9_-]{1,40}")


@dataclass(frozen=True, slots=True)
class Draft:
    """An unsaved text of one page.

    Attributes:
        page: name of the page that wrote it.
        text: the text.
        stamp: fingerprint of the file's content that it was made from.
        time: when it was written [s since 1970].
    """

    page: str
    text: str
    stamp: str
    time: float


class Drafts:
    """The drafts of one file."""

    def __init__(self, path: Path, cache: Path | None = None) -> None:
        """
        Args:
            path: the file that is edited.
            cache: folder to keep them in; by default `pomona/drafts` in the user's cache.
        """
        base = (
            cache
            or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
            / "pomona"
            / "drafts"
        )
        self._folder = base / hashlib.sha256(str(path).encode()).hexdigest()[:24]
        self._path = path

    def keep(self, draft: Draft) -> None:
        """Write a page's draft in place of its last one. Raises OSError: it cannot be written."""
        target = self._place(draft.page)
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._seen(
            draft.page
        ).touch()  # first: another editor would take the draft for that of a closed page
        replace_file(target, json.dumps({"path": str(self._path), **asdict(draft)}).encode())
        for old in self.all()[MOST_DRAFTS:]:
            self.drop(old.page)

    def drop(self, page: str) -> None:
        """Remove a page's draft; harmless without one."""
        with contextlib.suppress(OSError):
            self._place(page).unlink(missing_ok=True)
            self._seen(page).unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            self._folder.rmdir()

    def note_open(self, page: str) -> None:
        """Note that a page with a draft is open now: the editors of other processes see it, too."""
        with contextlib.suppress(OSError):
            if self._place(page).is_file():
                self._seen(page).touch()

    def is_open(self, page: str, within: float) -> bool:
        """Whether a page with a draft was open within this time [s]."""
        with contextlib.suppress(OSError):
            return time.time() - self._seen(page).stat().st_mtime < within
        return False

    def all(self) -> list[Draft]:
        """Return the drafts, the newest first; damaged ones are left out."""
        found = []
        for path in self._folder.glob("*.json"):
            with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                said = json.loads(path.read_text("utf-8"))
                found.append(
                    Draft(path.stem, str(said["text"]), str(said["stamp"]), float(said["time"]))
                )
        return sorted(found, key=lambda draft: -draft.time)

    def _place(self, page: str) -> Path:
        """Raises ValueError: a page has no such name."""
        if not PAGE.fullmatch(page):
            raise ValueError(f"'{page[:40]}' is no name of a page")
        return self._folder / f"{page}.json"

    def _seen(self, page: str) -> Path:
        return self._place(page).with_suffix(".open")
