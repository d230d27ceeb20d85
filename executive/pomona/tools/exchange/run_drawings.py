"""Drawings for the page of a run: its tree with each node's last result, and a lane for each skill over time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from pomona.executive.palette import BAD, GOOD, LINE, MUTED
from pomona.executive.running.events import Event, NodeChanged, RunEnded, RunStarted
from pomona.tools.tree_drawing.drawn_tree import drawing

BOX = "<g><title>"  # begins each node's box in a drawn tree
RANKS = {"SUCCESS": "good", "FAILURE": "bad", "RUNNING": "bad"}
"""Classes of nodes by their last result; a node that never ended was interrupted."""

INSTANT = 1e-3  # shorter skills have no lane of their own [s]
STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0)
"""Distances of ticks on the axis of time [s]."""

WIDE, NAMES, LANE, TOP = 1000.0, 170.0, 20.0, 34.0
"""Width of the picture, width of its names, height of a lane, height of the axis [px]."""
LETTER = 7.6
"""Width of a letter of a failure's code [px]: capitals of 12 px."""

STYLE = f"""svg.time text{{font:12px system-ui,sans-serif}}div.drawn{{overflow:auto}}
g.idle>rect:last-of-type{{fill:none;stroke:{LINE}}}g.idle>text{{fill:{MUTED}}}
g.good>rect:last-of-type{{fill:{GOOD};fill-opacity:.16;stroke:{GOOD}}}
g.bad>rect:last-of-type{{fill:{BAD};fill-opacity:.2;stroke:{BAD};stroke-width:2}}"""


@dataclass(slots=True)
class _Span:
    """A time for which a skill was active, with its result."""

    start: float
    end: float = math.inf
    status: str = "RUNNING"
    why: str = ""

    @property
    def result(self) -> str:
        """A word for it."""
        return self.status.lower() if self.status != "RUNNING" else "interrupted"


def drawn_tree(record: Path, events: Iterable[Event]) -> str:
    """Return the tree as SVG, green where a node succeeded last and red where it failed; empty without a tree."""
    nodes: list[str] = []
    results: dict[str, str] = {}
    for event in events:
        if isinstance(event, RunStarted):
            paths = [(str(node.get("path", "")), str(node.get("kind", ""))) for node in event.nodes]
            nodes = [
                path for path, kind in paths if not path.endswith(f":{kind}")
            ]  # a modifier has no box
        elif isinstance(event, NodeChanged) and event.status in RANKS:
            results[event.path] = event.status
    pieces = (drawing(record) or "").split(BOX)
    if len(pieces) != len(nodes) + 1:  # of another tree
        return ""
    ranks = (RANKS.get(results.get(path, ""), "idle") for path in nodes)
    boxes = (
        f'<g class="{rank}"><title>{piece}' for rank, piece in zip(ranks, pieces[1:], strict=True)
    )
    key = '<p class="about">Last result of each node: green succeeded, red failed or interrupted, grey never started.</p>'
    return f'{key}<div class="drawn" tabindex="0">{pieces[0]}{"".join(boxes)}</div>'


def timeline(events: Iterable[Event]) -> str:
    """Return a lane for each skill over the time of the run as SVG; empty when no skill took time."""
    names: dict[str, str] = {}
    spans: dict[str, list[_Span]] = {}  # of each skill, in the order of the skills' starts
    length = 0.0
    for event in events:
        length = max(length, event.t)
        if isinstance(event, RunStarted):
            parents = {node.get("parent") for node in event.nodes}
            leaves = (node for node in event.nodes if node.get("path") not in parents)
            names = {str(node.get("path", "")): str(node.get("name", "")) for node in leaves}
        elif isinstance(event, NodeChanged) and event.path in names:
            _extend(spans, event)
        elif isinstance(event, RunEnded):
            break
    for span in itertools.chain.from_iterable(spans.values()):
        span.end = min(span.end, length)
    lanes = {path: of for path, of in spans.items() if _is_drawn(of)}
    if not lanes or length <= 0.0:
        return ""
    return _lanes(lanes, names, length)


def _is_drawn(spans: Sequence[_Span]) -> bool:
    """Return True if a skill took time or did not succeed."""
    took = sum(span.end - span.start for span in spans)
    return any(took >= INSTANT or span.status != "SUCCESS" for span in spans)


def _extend(spans: dict[str, list[_Span]], event: NodeChanged) -> None:
    """Begin or end the last span of a skill."""
    last = spans[event.path][-1] if event.path in spans else None
    is_open = last is not None and math.isinf(last.end)
    if event.status == "RUNNING":
        if not is_open:
            spans.setdefault(event.path, []).append(_Span(event.t))
        return
    if not is_open and event.status != "INVALID":
        last = _Span(event.t)
        spans.setdefault(event.path, []).append(last)
    elif not is_open:
        return
    assert last is not None
    last.end = event.t
    if event.status != "INVALID":
        last.status = event.status
        last.why = event.reason.code if event.reason is not None else ""


def _labels(spans: Sequence[_Span], scale: float, y: float) -> Iterator[str]:
    """Yield how spans of a lane ended, not by colour alone: the last ones first, as far as they have room."""
    bars = [_bar(span, scale) for span in spans]
    taken = list(bars)
    for span, (x, end) in reversed(list(zip(spans, bars, strict=True))):
        mark = {"SUCCESS": "", "FAILURE": "✗"}.get(span.status, "■")
        texts = (f"{mark} {span.why or span.result}", mark) if mark else ()
        for words, anchor in itertools.product(texts, ("start", "end")):
            long = LETTER * len(words)
            low = end + 5.0 if anchor == "start" else x - 5.0 - long
            if low + long < WIDE and all(
                low + long <= before or low >= behind for before, behind in taken
            ):
                taken.append((low, low + long))
                at = f'x="{low if anchor == "start" else low + long:.1f}" text-anchor="{anchor}"'
                yield f'<text {at} y="{y:.0f}" fill="{BAD}">{escape(words)}</text>'
                break


def _bar(span: _Span, scale: float) -> tuple[float, float]:
    """Return where a span's bar begins and ends [px]."""
    x = NAMES + span.start * scale
    return x, max(x + 2.5, NAMES + span.end * scale)


def _lanes(lanes: Mapping[str, Sequence[_Span]], names: Mapping[str, str], length: float) -> str:
    height = TOP + LANE * len(lanes) + 4.0
    scale = (WIDE - NAMES - 20.0) / length
    step = next((step for step in STEPS if step >= length / 10.0), math.ceil(length / 10.0))
    parts = []
    for tick in range(int(length / step) + 1):
        x = NAMES + tick * step * scale
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="16" y2="{height:.0f}" stroke="{LINE}"/>')
        parts.append(
            f'<text x="{x:.1f}" y="12" text-anchor="middle" fill="{MUTED}">{tick * step:g} s</text>'
        )
    for row, (path, spans) in enumerate(lanes.items()):
        y = TOP + row * LANE
        parts.append(f'<text x="0" y="{y + 14:.0f}">{escape(names[path][:26])}</text>')
        for span in spans:
            x, end = _bar(span, scale)
            about = f"{f'{names[path]} {span.result} {span.why}'.rstrip()}, {span.start:.1f} s to {span.end:.1f} s"
            colour = GOOD if span.status == "SUCCESS" else BAD
            parts.append(
                f'<rect x="{x:.1f}" y="{y + 3:.0f}" width="{end - x:.1f}" height="{LANE - 6:.0f}" fill="{colour}">'
            )
            parts.append(f"<title>{escape(about)}</title></rect>")
        parts.extend(_labels(spans, scale, y + 14))
    frame = f'viewBox="0 0 {WIDE:.0f} {height:.0f}" role="img" aria-label="skills over time"'
    return f'<svg class="time" {frame}>{"".join(parts)}</svg>'
