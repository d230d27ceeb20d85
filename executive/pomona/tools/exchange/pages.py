"""A run as one self-contained HTML page.

The file holds the explanation, the tables and the recorded images with their overlays.
"""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.palette import OVERLAY
from pomona.executive.recording.digest import Digest, trusted
from pomona.executive.recording.folder import EVENTS, events_file, is_being_written
from pomona.executive.recording.plain_file import made_whole, open_plain, parse_object, refuse_taken
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import IMAGES
from pomona.executive.running.events import Published
from pomona.executive.terminal.explain import explain
from pomona.executive.values.image_bytes import size_of_image
from pomona.executive.views import TableView
from pomona.tools.exchange.run_drawings import STYLE, drawn_tree, timeline

LOOKS = 2  # the newest pictures of a failed run that are shown beside others
MOST_PICTURE_BYTES = 20_000_000  # of the run's own picture

_STYLE = (
    """body{font:16px/1.5 system-ui,sans-serif;max-width:78rem;margin:2rem auto;padding:0 1rem;color:#222}
section{border-top:1px solid #ccc;margin-top:2rem}code{background:#eee;padding:0 .3em}p.about,figcaption{color:#666}
figure{position:relative;display:inline-block;width:48%;margin:0 1% 1rem 0}figure img{width:100%;display:block}
figure svg{position:absolute;inset:0 0 auto 0;width:100%}img.whole{width:100%}
figure svg path{fill:none;vector-effect:non-scaling-stroke;
stroke-width:2px}table{border-collapse:collapse;display:block;overflow-x:auto}td,th{padding:.1em .8em;text-align:right;
border-bottom:1px solid #ddd;white-space:nowrap}figure{vertical-align:top}"""
    + STYLE
)
_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<style>{style}</style></head><body>"""


@dataclass(frozen=True, slots=True)
class _Look:
    """A recorded picture with its last overlay."""

    topic: str
    jpeg: str
    view: dict[str, Any]


def write_failures(records: Sequence[Path], file: Path) -> int:
    """Write the page.

    Args:
        records: of any runs; those that failed are shown, in this order.
        file: of the page; there must be none yet.

    Returns:
        the number of failures that it shows.

    Raises UsageError: the file is there already or cannot be written, no run failed, or a record is not trustworthy.
    """
    refuse_taken(file)
    runs = [(record, trusted(record)) for record in records]
    failed = [
        (record, run)
        for record, run in runs
        if run.state == "ended" and run.outcome not in (None, "success")
    ]
    if not failed:
        raise UsageError(f"none of {len(runs)} runs failed")
    codes = Counter(run.code or run.outcome or "" for _record, run in failed)
    counted = ", ".join(
        f"<code>{escape(code)}</code> {count}" for code, count in codes.most_common()
    )
    sections = "".join(_section(record, run) for record, run in failed)
    title = f"{len(failed)} failed of {len(runs)} runs"
    _write(file, title, f"<h1>{title}</h1><p>{counted}</p>{sections}")
    return len(failed)


def write_run(record: Path, file: Path) -> None:
    """Write the page of one run: explanation, time, tree, picture, tables, every image with its last overlay.

    Raises UsageError: the file exists or cannot be written, or the record is damaged.
    """
    refuse_taken(file)
    drawings = (
        ("Time", timeline(read_events(record))),
        ("Tree", drawn_tree(record, read_events(record))),
        ("The run in one picture", _whole(record)),
    )
    body = "".join(f"<h3>{title}</h3>{drawn}" for title, drawn in drawings if drawn) + "".join(
        _tables(record)
    )
    title = f"Events of {record.name}"
    section = _section(record, trusted(record), 24, body)  # of one run, the newest
    _write(file, title, f"<h1>{escape(title)}</h1>{section}")


def _write(file: Path, title: str, body: str) -> None:
    whole = f"{_HEAD.format(title=escape(title), style=_STYLE)}{body}</body></html>\n"
    with made_whole(file) as place:
        place.write_text(whole, encoding="utf-8", errors="replace")


def _whole(record: Path) -> str:
    """Return the picture that the run left, with its forces over time; an empty text when there is none."""
    try:
        with open_plain(record / "picture.png") as file:
            image = file.read(MOST_PICTURE_BYTES + 1)
    except OSError:
        return ""
    if not image.startswith(b"\x89PNG") or len(image) > MOST_PICTURE_BYTES:
        return ""
    source = base64.b64encode(image).decode("ascii")
    return f'<p><img class="whole" alt="the run in one picture" src="data:image/png;base64,{source}"></p>'


def _section(record: Path, run: Digest, most: int = LOOKS, body: str | None = None) -> str:
    began = datetime.fromtimestamp(run.wall_time).astimezone().isoformat(" ", "minutes")
    settings = " ".join(f"{key}={value}" for key, value in run.settings.items())
    about = f"{began} · {run.tree} on {run.cell} ({run.cell_kind}) · seed {run.seed} {settings}"
    sentences = ""
    if run.outcome != "success" or body is not None:
        going_on, why_cut = (
            is_being_written(events_file(record)),
            run.message or "the reason is unknown",
        )
        told = [
            explain(read_events(record), going_on, why_cut, whole=whole) for whole in (False, True)
        ]
        brief, rest = told[0], told[1][len(told[0]) :]
        sentences = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in brief)
        more = "".join(f"<p>{escape(paragraph)}</p>" for paragraph in rest)
        sentences += f"<details><summary>Every moment</summary>{more}</details>" if more else ""
    pictures = "".join(_figure(look) for look in _looks(record, most))
    title = f"{escape(run.run)} <code>{escape(run.code or run.outcome or 'not ended')}</code>"
    return f'<section><h2>{title}</h2><p class="about">{escape(about)}</p>{sentences}{body or ""}{pictures}</section>'


def _looks(record: Path, most: int) -> list[_Look]:
    """Return the newest pictures, each with the newest drawing of its topic over it."""
    looks: dict[tuple[str, str], _Look] = {}
    waiting: dict[str, str] = {}
    for topic, content, *_ in scan(events_file(record)):
        if topic.startswith(IMAGES):
            waiting[topic.removeprefix(IMAGES)] = str(parse_object(content).get("data", ""))
        elif waiting and topic == EVENTS:
            message = parse_object(content)
            name = str(message.get("topic", ""))
            if name in waiting and isinstance(message.get("value"), dict):
                jpeg = waiting.pop(name)
                looks.pop((name, jpeg), None)
                looks[name, jpeg] = _Look(name, jpeg, message["value"])
                if len(looks) > most:
                    del looks[next(iter(looks))]
    return list(looks.values())


def _figure(look: _Look) -> str:
    caption = str(look.view.get("caption", ""))
    image = f'<img alt="{escape(look.topic)}" src="data:image/jpeg;base64,{escape(look.jpeg)}">'
    words = f"{escape(look.topic)}: {escape(caption)}{_key(look)}"
    return f"<figure>{image}{_drawing(look)}<figcaption>{words}</figcaption></figure>"


def _key(look: _Look) -> str:
    """Return the labels of the lines over an image, each beside its colour."""
    try:
        lines = {
            str(line["label"]): _colour(line)
            for line in look.view.get("lines", ())
            if line.get("label")
        }
    except (TypeError, KeyError, AttributeError):  # a foreign record
        return ""
    return "".join(
        f'<br><span style="color:{colour}">■</span> {escape(label)}'
        for label, colour in lines.items()
    )


def _colour(line: dict[str, Any]) -> str:
    return OVERLAY.get(str(line.get("style")), OVERLAY["muted"])


def _drawing(look: _Look) -> str:
    try:
        width, height = size_of_image(base64.b64decode(look.jpeg))
        paths = "".join(_path(line) for line in look.view.get("lines", ()))
    except (ValueError, TypeError, KeyError, AttributeError):  # a foreign record: the picture alone
        return ""
    return f'<svg viewBox="0 0 {width} {height}">{paths}</svg>' if paths else ""


def _path(line: dict[str, Any]) -> str:
    points = np.asarray(line["points"], float).reshape(-1, 2)
    if not len(points) or not np.isfinite(points).all():
        return ""
    way = (
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + ("Z" if line.get("closed") else "")
    )
    return f'<path d="{way}" stroke="{_colour(line)}"/>'


def _tables(record: Path) -> list[str]:
    newest = {
        e.topic: e.value
        for e in read_events(record)
        if isinstance(e, Published) and isinstance(e.value, TableView)
    }
    tables = []
    for view in newest.values():
        head = "".join(f"<th>{escape(column)}</th>" for column in view.columns)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
            for row in view.rows
        )
        tables.append(f"<h3>{escape(view.caption)}</h3><table><tr>{head}</tr>{rows}</table>")
    return tables
