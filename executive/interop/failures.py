"""Failed runs with their pictures as one page that can be sent to somebody: it needs nothing but a browser.

Everything is in the file: what happened in sentences, and the last looks before the failure as they were recorded.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from datetime import datetime
from html import escape
from pathlib import Path

from executive.errors import UsageError
from executive.recording.digest import Digest, trusted
from executive.recording.folder import events_file, is_being_written
from executive.recording.json_text import parse_object
from executive.recording.read import read_events
from executive.recording.scan import scan
from executive.recording.well_known import IMAGES
from executive.terminal.explain import explain

LOOKS = 2
"""The newest pictures of a run that are shown."""

_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
section{border-top:1px solid #ccc;margin-top:2rem}img{max-width:49%;margin-right:1%}code{background:#eee;padding:0 .3em}
p.about{color:#666}"""
_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Failed runs</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<style>"""


def write_failures(records: Sequence[Path], file: Path) -> int:
    """Write the page.

    Args:
        records: of any runs; those that failed are shown, in this order.
        file: of the page; there must be none yet.

    Returns:
        how many failures it shows.

    Raises:
        UsageError: the file is there already or cannot be written, no run failed, or a record cannot be believed.
    """
    if file.exists():
        raise UsageError(f"{file} is there already")
    runs = [(record, trusted(record)) for record in records]
    failed = [(record, run) for record, run in runs if run.state == "ended" and run.outcome not in (None, "success")]
    if not failed:
        raise UsageError(f"none of {len(runs)} runs failed")
    codes = Counter(run.code or run.outcome or "" for _record, run in failed)
    counted = ", ".join(f"<code>{escape(code)}</code> {count}" for code, count in codes.most_common())
    sections = "".join(_section(record, run) for record, run in failed)
    title = f"{len(failed)} failed of {len(runs)} runs"
    page = f"{_HEAD}{_STYLE}</style></head><body><h1>{title}</h1><p>{counted}</p>{sections}</body></html>\n"
    try:
        with file.open("x", encoding="utf-8", errors="replace") as stream:
            stream.write(page)
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror or error}") from error
    return len(failed)


def _section(record: Path, run: Digest) -> str:
    began = datetime.fromtimestamp(run.wall_time).astimezone().isoformat(" ", "minutes")
    settings = " ".join(f"{key}={value}" for key, value in run.settings.items())
    about = f"{began} · {run.tree} on {run.cell} ({run.cell_kind}) · seed {run.seed} {settings}"
    why = explain(read_events(record), is_being_written(events_file(record)), run.message or "nobody knows why")
    sentences = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in why)
    pictures = "".join(
        f'<img alt="{escape(topic)}" src="data:image/jpeg;base64,{escape(data)}">' for topic, data in _looks(record)
    )
    title = f"{escape(run.run)} <code>{escape(run.code or run.outcome or '')}</code>"
    return f'<section><h2>{title}</h2><p class="about">{escape(about)}</p>{sentences}{pictures}</section>'


def _looks(record: Path) -> list[tuple[str, str]]:
    """The newest pictures: topic and JPEG in base 64."""
    newest: deque[bytes] = deque(maxlen=LOOKS)
    topics: deque[str] = deque(maxlen=LOOKS)
    for topic, content in scan(events_file(record)):
        if topic.startswith(IMAGES):
            newest.append(content)
            topics.append(topic.removeprefix(IMAGES))
    return [(topic, str(parse_object(content).get("data", ""))) for topic, content in zip(topics, newest, strict=True)]
