"""Report of fruit as files: two tables, a page, and one picture per frame with the rows' numbers."""

from __future__ import annotations

import csv
import io
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pomona.applications.inventory.fruit_report import (
    FIND_COLUMNS,
    FIND_WORDS,
    FRUIT_COLUMNS,
    FRUIT_WORDS,
    FrameEntry,
    FruitReport,
    find_said,
    fruit_said,
    width_mm,
)
from pomona.executive import OVERLAY, ImageView, UInt8
from pomona.skills.perception import mass_model, mass_of
from pomona.tools.library.campaign.document import (
    Heading,
    PagePicture,
    Paragraph,
    ReportPage,
    Table,
    Tile,
    Tiles,
    to_html,
)

FINDS, FRUIT, PAGE, PICTURES = "finds.csv", "fruit.csv", "index.html", "pictures"

MOST_FRAMES = 100  # frames that the page shows with their pictures and rows; the tables have all

WHY = {
    "NO_DEPTH": "the depth camera saw nothing there",
    "TOO_FEW_INLIERS": "too little of the depth has a fruit's shape: it is too hidden, or it is no fruit",
    "SIZE_OUT_OF_RANGE": "it would be far larger or smaller than this kind of fruit is",
    "AT_BOUND": "the depth there is not the fruit's: it is hidden, or it is no fruit",
    "NOT_ITS_SHAPE": "the surface there is flat in a direction in which this fruit is round: a leaf, a post or a wall",
    "RENDER_FAILED": "its model could not be drawn where it was seen",
}
"""Texts for the codes of Refine."""


@dataclass(frozen=True, slots=True)
class Page:
    """A folder with the tables, the page and the pictures. Each file is written whole, or not at all."""

    folder: Path

    def problem(self) -> str:
        """Why nothing can be written there; empty where it can."""
        try:
            if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
                return f"{self.folder} is there already"
        except OSError as error:
            return f"{self.folder}: {error.strerror}"
        above = next(
            path for path in (self.folder, *self.folder.absolute().parents) if path.exists()
        )
        if not above.is_dir():
            return f"{above} is not a folder"
        return "" if os.access(above, os.W_OK | os.X_OK) else f"nothing can be written into {above}"

    def write_picture(self, entry: FrameEntry, view: ImageView) -> None:
        """A frame's picture. Raises OSError: it cannot be written."""
        assert view.image is not None
        _, jpeg = cv2.imencode(".jpg", draw(view)[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 88))
        _put(self.folder / PICTURES / entry.picture, jpeg.tobytes())

    def write(self, report: FruitReport, of: int) -> None:
        """Both tables and the page. Raises OSError: they cannot be written."""
        _put(self.folder / FINDS, _csv(FIND_COLUMNS, report.find_rows()))
        _put(self.folder / FRUIT, _csv(FRUIT_COLUMNS, report.fruit_rows()))
        _put(self.folder / PAGE, to_html(make_page(report, of)).encode())


def make_page(report: FruitReport, of: int = 0) -> ReportPage:
    """Return the page: totals, sizes, each fruit, each frame with its picture and rows."""
    book, frames = report.book, report.frames
    kind = book.fruit[0].sightings[0].fruit if book.fruit else None
    done = len(frames)
    unfinished = f" · {done} of {of} frames so far" if of > done else ""
    page = ReportPage(
        f"{len(book.fruit)} fruit in {_frames(done)}",
        f"{kind.name if kind else 'no fruit'}{unfinished} · `{FRUIT}`: a row a fruit, `{FINDS}`: a row a find",
    )
    sizes = [fruit.size for fruit in book.fruit if fruit.size is not None]
    masses = [mass_of(kind, size.dimensions, size.covariance) for size in sizes] if kind else []
    measured = f"{report.measured} of them measured; {_scenes(book.scenes)}"
    tiles = [Tile("fruit, each counted once", str(len(book.fruit)), measured)]
    if sizes:
        widths = [width_mm(size.dimensions) for size in sizes]
        span = f"{min(widths):.0f} to {max(widths):.0f} mm"
        tiles.append(Tile("median width", f"{np.median(widths):.1f} mm", span))
    if masses and all(masses):
        tiles.append(
            Tile(
                "estimated mass of those measured",
                f"{sum(mass[0] for mass in masses if mass):.2f} kg",
                "by their sizes",
            )
        )
    page.add(Tiles(tuple(tiles)))
    if report.doubt:
        page.add(
            Paragraph(
                f"These figures are not reliable yet: {report.doubt}"
                if report.measured
                else report.doubt
            )
        )
    if any(entry.unreadable for entry in frames):
        page.add(Heading("Frames that could not be looked at"))
        page.add(
            Table(
                ("frame", "why"),
                tuple((str(e.number), e.unreadable) for e in frames if e.unreadable),
                words=True,
            )
        )
    if sizes:
        page.add(Heading("Widths"))
        view = report.size_classes()
        rows = view.rows if len(view.rows) <= MOST_FRAMES + 1 else view.rows[-1:]
        page.add(
            Table(
                view.columns,
                rows,
                "How many fruit of each width; a fruit that two frames show is one in the last row.",
            )
        )
    if book.fruit:
        page.add(Heading("Fruit"))
        page.add(Table(FRUIT_WORDS, tuple(map(fruit_said, book.fruit))))
        page.add(Paragraph(_how_to_read(report), note=True))
        refused = _refusals(report)
        if refused is not None:
            page.add(refused)
    for entry in frames[:MOST_FRAMES]:
        if not entry.unreadable:
            _add_frame(page, entry)
    if done > MOST_FRAMES:
        page.add(
            Paragraph(
                f"{done - MOST_FRAMES} further frames: their rows are in `{FINDS}`, their pictures in `{PICTURES}`."
            )
        )
    return page


def draw(view: ImageView) -> UInt8:
    """Return a view's image with its lines and their labels, RGB, shape (h, w, 3)."""
    assert view.image is not None
    drawn = np.ascontiguousarray(view.image).copy()
    thick = max(1, round(drawn.shape[1] / 960))
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * max(1.0, drawn.shape[1] / 1280)
    for line in view.lines:
        if not len(line.points):
            continue
        colour = tuple(int(OVERLAY[line.style][k : k + 2], 16) for k in (1, 3, 5))
        cv2.polylines(
            drawn, [np.round(line.points).astype(np.int32)], line.closed, colour, thick, cv2.LINE_AA
        )
        (width, height), _ = cv2.getTextSize(line.label, font, scale, thick)
        (left, top), (right, bottom) = line.points.min(axis=0), line.points.max(axis=0)
        at = (int(0.5 * (left + right - width)), int(0.5 * (top + bottom + height)))
        cv2.putText(drawn, line.label, at, font, scale, (20, 20, 20), 3 * thick, cv2.LINE_AA)
        cv2.putText(drawn, line.label, at, font, scale, (255, 255, 255), thick, cv2.LINE_AA)
    return drawn


def _add_frame(page: ReportPage, entry: FrameEntry) -> None:
    page.add(Heading(entry.label))
    page.add(
        Paragraph(
            f"{len(entry.finds)} found, {entry.measured} measured. Scene {entry.scene}: {entry.how}."
        )
    )
    if entry.doubt:
        page.add(Paragraph(f"In doubt: {entry.doubt}."))
    about = f"{entry.label} with the outline and number of each fruit"
    page.add(
        PagePicture(
            f"{PICTURES}/{entry.picture}", about, "Green: measured. Amber: found and not measured."
        )
    )
    if entry.finds:
        page.add(
            Table(FIND_WORDS, tuple(find_said(sighting, fruit) for sighting, fruit in entry.finds))
        )


def _refusals(report: FruitReport) -> Table | None:
    """Return the table of refusals: reason, number and meaning."""
    codes = Counter(fruit.why for fruit in report.book.fruit if fruit.why)
    rows = tuple((code, str(count), WHY.get(code, "")) for code, count in codes.most_common())
    return Table(("not measured", "fruit", "meaning"), rows, words=True) if rows else None


def _how_to_read(report: FruitReport) -> str:
    kind = report.book.fruit[0].sightings[0].fruit
    words = "± is half the width of the interval that contains the true value in 90 of 100 cases.  "
    words += "Width and depth are level, height goes along the stem. Places are in the base frame where the camera's "
    words += "place is known, else in a level frame at the scene's first camera (x right, y ahead, z up); ≈ is guessed by "
    words += "the size in the picture. "
    if any(fruit.size is not None and not fruit.size.agree for fruit in report.book.fruit):
        words += "Measurements that disagree differ by more than their uncertainty: their interval is widened.  "
    model = mass_model(kind)
    return words + (
        f"Mass: {model}." if model else f"No mass: the model of {kind.name} has no weighed fruit."
    )


def _frames(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _scenes(count: int) -> str:
    if count <= 1:
        return "in one scene"
    return f"in {count} scenes that are not joined: a fruit that two scenes show is counted in both"


def _csv(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue().encode()


def _put(path: Path, content: bytes) -> None:
    """A file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.new")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise
