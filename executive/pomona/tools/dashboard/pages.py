"""A run as one self-contained HTML page: its explanation, tree, tables and recorded images with their overlays."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import PomonaError
from pomona.executive.language.check import read_document
from pomona.executive.palette import BAD, GOOD, LINE, MUTED, OVERLAY
from pomona.executive.recording.digest import Digest, trusted
from pomona.executive.recording.folder import EVENTS, events_file, is_being_written
from pomona.executive.recording.plain_file import (
    is_plain,
    made_whole,
    open_plain,
    parse_object,
    refuse_taken,
)
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import IMAGES
from pomona.executive.running.events import Event, NodeChanged, Published, RunStarted
from pomona.executive.values.image_bytes import size_of_image
from pomona.executive.views import TableView
from pomona.tools.dashboard.drawing import show_svg
from pomona.tools.dashboard.explain import explain

LOOKS = 24  # the newest pictures of the run that are shown
MOST_PICTURE_BYTES = 20_000_000  # of the run's own picture
MOST_TREE = 1_000_000  # bytes of a tree file that is drawn

BOX = "<g><title>"  # begins each node's box in a drawn tree
RANKS = {"SUCCESS": "good", "FAILURE": "bad", "RUNNING": "bad"}
"""Classes of nodes by their last result; a node that never ended was interrupted."""

_STYLE = f"""body{{font:16px/1.5 system-ui,sans-serif;max-width:78rem;margin:2rem auto;padding:0 1rem;color:#222}}
section{{border-top:1px solid #ccc;margin-top:2rem}}code{{background:#eee;padding:0 .3em}}
p.about,figcaption{{color:#666}}div.drawn{{overflow:auto}}
figure{{position:relative;display:inline-block;width:48%;margin:0 1% 1rem 0;vertical-align:top}}
figure img{{width:100%;display:block}}
figure svg{{position:absolute;inset:0 0 auto 0;width:100%}}img.whole{{width:100%}}
figure svg path{{fill:none;vector-effect:non-scaling-stroke;stroke-width:2px}}
table{{border-collapse:collapse;display:block;overflow-x:auto}}
td,th{{padding:.1em .8em;text-align:right;border-bottom:1px solid #ddd;white-space:nowrap}}
g.idle>rect:last-of-type{{fill:none;stroke:{LINE}}}g.idle>text{{fill:{MUTED}}}
g.good>rect:last-of-type{{fill:{GOOD};fill-opacity:.16;stroke:{GOOD}}}
g.bad>rect:last-of-type{{fill:{BAD};fill-opacity:.2;stroke:{BAD};stroke-width:2}}"""
_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<style>{style}</style></head><body><h1>{title}</h1>"""


@dataclass(frozen=True, slots=True)
class _Look:
    """A recorded picture with its last overlay."""

    topic: str
    jpeg: str
    view: dict[str, Any]


def write_run(record: Path, file: Path) -> None:
    """Write the page of one run: explanation, tree, picture, tables, every image with its last overlay.

    Raises UsageError: the file exists or cannot be written, or the record is damaged.
    """
    refuse_taken(file)
    run = trusted(record)
    head = _HEAD.format(title=escape(f"Events of {record.name}"), style=_STYLE)
    parts = (
        head,
        *_summary(record, run),
        _drawn_tree(record, read_events(record)),
        _own_picture(record),
        *_tables(record),
        *(_figure(look) for look in _looks(record)),
        "</section></body></html>\n",
    )
    with made_whole(file) as place:
        place.write_text("".join(parts), encoding="utf-8", errors="replace")


def _summary(record: Path, run: Digest) -> Iterator[str]:
    """Yield the run's name, its settings, and its events as sentences; all but the first are folded."""
    yield f"<section><h2>{escape(run.run)} <code>{escape(run.code or run.outcome or 'not ended')}</code></h2>"
    began = datetime.fromtimestamp(run.wall_time).astimezone().isoformat(" ", "minutes")
    settings = " ".join(f"{key}={value}" for key, value in run.settings.items())
    about = f"{began} · {run.tree} on {run.cell} ({run.cell_kind}) · seed {run.seed} {settings}"
    yield f'<p class="about">{escape(about)}</p>'
    going_on = is_being_written(events_file(record))
    why_cut = run.message or "the reason is unknown"
    brief = explain(read_events(record), going_on, why_cut, whole=False)
    whole = explain(read_events(record), going_on, why_cut, whole=True)
    yield from (f"<p>{escape(paragraph)}</p>" for paragraph in brief)
    yield "<details><summary>Every moment</summary>"
    yield from (f"<p>{escape(paragraph)}</p>" for paragraph in whole[len(brief) :])
    yield "</details>"


def _drawn_tree(record: Path, events: Iterable[Event]) -> str:
    """Return the tree as SVG, each node coloured by its last result; empty without a tree."""
    nodes: list[str] = []
    results: dict[str, str] = {}
    for event in events:
        if isinstance(event, RunStarted):
            paths = [(str(node.get("path", "")), str(node.get("kind", ""))) for node in event.nodes]
            # a modifier has no box
            nodes = [path for path, kind in paths if not path.endswith(f":{kind}")]
        elif isinstance(event, NodeChanged) and event.status in RANKS:
            results[event.path] = event.status
    start, *pieces = (drawing(record) or "").split(BOX)
    if not pieces or len(pieces) != len(nodes):  # of another tree
        return ""
    boxes = (
        f'<g class="{RANKS.get(results.get(path, ""), "idle")}"><title>{piece}'
        for path, piece in zip(nodes, pieces, strict=True)
    )
    key = (
        "Last result of each node: green succeeded, red failed or interrupted, grey never started."
    )
    tree = f'<div class="drawn" tabindex="0">{start}{"".join(boxes)}</div>'
    return f'<h3>Tree</h3><p class="about">{key}</p>{tree}'


def drawing(folder: Path) -> str | None:
    """Return the picture (SVG), or None for a record without a tree that can be drawn."""
    path = folder / "tree.yaml"
    if not is_plain(path) or path.stat().st_size > MOST_TREE:
        return None
    try:
        document = read_document(path)
    except (PomonaError, OSError):
        return None
    return None if document.main.main is None else show_svg(document)


def _own_picture(record: Path) -> str:
    """Return the picture that the run left, with its forces over time; an empty text when there is none."""
    try:
        with open_plain(record / "picture.png") as file:
            image = file.read(MOST_PICTURE_BYTES + 1)
    except OSError:
        return ""
    if not image.startswith(b"\x89PNG") or len(image) > MOST_PICTURE_BYTES:
        return ""
    title = "The run in one picture"
    source = base64.b64encode(image).decode("ascii")
    return f'<h3>{title}</h3><p><img class="whole" alt="{title}" src="data:image/png;base64,{source}"></p>'


def _looks(record: Path) -> list[_Look]:
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
                if len(looks) > LOOKS:
                    del looks[next(iter(looks))]
    return list(looks.values())


def _figure(look: _Look) -> str:
    caption = escape(f"{look.topic}: {look.view.get('caption', '')}")
    image = f'<img alt="{escape(look.topic)}" src="data:image/jpeg;base64,{escape(look.jpeg)}">'
    try:
        lines = [line for line in look.view.get("lines", ()) if len(line["points"])]
        words = f"{caption}{''.join(_key(lines))}"
        overlay = _overlay(look.jpeg, lines)
    except (ValueError, TypeError, KeyError, AttributeError):  # a foreign record
        words = caption
        overlay = ""
    return f"<figure>{image}{overlay}<figcaption>{words}</figcaption></figure>"


def _key(lines: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the labels of the lines over an image, each beside its colour."""
    labels = {str(line["label"]): _colour(line) for line in lines if line.get("label")}
    for label, colour in labels.items():
        yield f'<br><span style="color:{colour}">■</span> {escape(label)}'


def _colour(line: dict[str, Any]) -> str:
    return OVERLAY.get(str(line.get("style")), OVERLAY["muted"])


def _overlay(jpeg: str, lines: list[dict[str, Any]]) -> str:
    width, height = size_of_image(base64.b64decode(jpeg))
    paths = "".join(_path(line) for line in lines)
    return f'<svg viewBox="0 0 {width} {height}">{paths}</svg>' if paths else ""


def _path(line: dict[str, Any]) -> str:
    points = np.asarray(line["points"], float).reshape(-1, 2)
    if not np.isfinite(points).all():
        return ""
    corners = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="M{corners}{"Z" if line.get("closed") else ""}" stroke="{_colour(line)}"/>'


def _tables(record: Path) -> Iterator[str]:
    newest = {
        event.topic: event.value
        for event in read_events(record)
        if isinstance(event, Published) and isinstance(event.value, TableView)
    }
    for view in newest.values():
        head = "".join(f"<th>{escape(column)}</th>" for column in view.columns)
        yield f"<h3>{escape(view.caption)}</h3><table><tr>{head}</tr>"
        for row in view.rows:
            yield "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
        yield "</table>"
