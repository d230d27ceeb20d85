"""The account of fruit in many frames: who is who, and the rows of its tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.applications.inventory.book import FruitBook, KnownFruit
from pomona.applications.inventory.sighting import Z_90, Sighting
from pomona.executive import Float64, ImageView, Line2, TableView, UInt8
from pomona.skills.perception import FruitModel, mass_model, mass_of

CLASS_MM = (
    5  # width of a size class [mm], as fruit is sorted for sale (UNECE standard FFV-50, apples)
)

LEAST_TELLING = 3  # least number of fruit to state that all are too large or too small
FEW = 0.1  # share of measured fruit below which the depth is doubted: of the orchard's two frames it is 0.6

UNLIKE_MODEL = 0.5, 1.25
"""Fruit of a kind of which only the model is known are at least and at most so large, beside it, in the middle: the
orchard's 52 calipered apples are 0.73 of theirs."""

_SIZE = (
    "width_mm", "width_90_mm", "height_mm", "height_90_mm", "depth_mm", "depth_90_mm", "mass_g", "mass_90_g",
    "mass_model",
)  # fmt: skip
FIND_COLUMNS = (
    "frame", "row", "fruit", "scene", "score", *_SIZE, "x_mm", "y_mm", "z_mm", "distance_m", "u_px", "v_px", "visible",
    "agreeing", "shown_mm", "shown_90_mm", "from_side", "method", "not_measured", "doubt",
)  # fmt: skip
FRUIT_COLUMNS = (
    "fruit", "scene", "frames", "looks_that_measured", "score", *_SIZE, "x_mm", "y_mm", "z_mm", "looks_agree",
    "not_measured",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class FrameEntry:
    """One frame of the account."""

    number: int  # from 1, in the order in which they were looked at
    label: str  # its name
    scene: int  # from 1; 0 if it could not be processed
    how: str  # origin of the camera's pose, or the reason why it is unknown
    # detections in it, places in the scene's frame, each with the number of its fruit
    finds: tuple[tuple[Sighting, int], ...]
    unreadable: str = ""  # reason why it could not be processed; empty if it could
    doubt: str = ""  # reason why sizes or places in it may be wrong; empty without one

    @property
    def picture(self) -> str:
        """Its picture's name."""
        return f"{self.number:04d}_{re.sub(r'[^A-Za-z0-9._-]+', '_', self.label)[:60]}.jpg"

    @property
    def measured(self) -> int:
        """How many of its finds were measured."""
        return sum(sighting.dimensions is not None for sighting, _fruit in self.finds)


@dataclass(slots=True)
class FruitReport:
    """All frames so far, and the fruit that they show."""

    book: FruitBook = field(default_factory=FruitBook)
    frames: list[FrameEntry] = field(default_factory=list)
    _finds: int = 0
    _told: int = -1

    def add(
        self,
        label: str,
        sightings: Sequence[Sighting],
        T_scene_base: Float64 | None,
        deviation: float,
        how: str,
        doubt: str = "",
    ) -> None:
        """Add one frame, with the values of `FrameEntry`; see `FruitBook.add_frame`."""
        numbers = self.book.add_frame(sightings, T_scene_base, deviation)
        T = np.eye(4) if T_scene_base is None else T_scene_base
        finds = tuple(
            (sighting.moved(T), number) for sighting, number in zip(sightings, numbers, strict=True)
        )
        if (
            self.frames and self.frames[-1].finds
        ):  # outlines are for the newest frame's picture alone
            self.frames[-1] = _without_outlines(self.frames[-1])
        self.frames.append(
            FrameEntry(len(self.frames) + 1, label, self.book.scenes, how, finds, doubt=doubt)
        )
        self._finds += len(finds)

    def add_unreadable(self, why: str) -> None:
        """One frame that could not be looked at."""
        number = len(self.frames) + 1
        self.frames.append(FrameEntry(number, f"frame {number}", 0, "", (), why))

    def is_due(self, last: bool) -> bool:
        """Return True when the tables are due: always at first, after a growth by a twentieth, and at the end."""
        due = last or len(self.frames) <= 20 or self._finds >= 1.05 * self._told
        if due:
            self._told = self._finds
        return due

    @property
    def measured(self) -> int:
        """How many fruit have a size."""
        return sum(fruit.size is not None for fruit in self.book.fruit)

    def sentence(self, of: int = 0) -> str:
        """Describe the progress for the operator."""
        newest = self.frames[-1]
        done = f"{len(self.frames)} of {of} frames" if of else f"{len(self.frames)} frames"
        here = (
            newest.unreadable
            or f"{newest.label}: {len(newest.finds)} found, {newest.measured} measured"
        )
        so_far = f"{done}, {here}; {len(self.book.fruit)} fruit so far, {self.measured} measured"
        return f"{so_far}; {self.doubt}" if self.doubt else so_far

    @property
    def doubt(self) -> str:
        """Reason why sizes and counts may be wrong; empty without one."""
        return "; ".join(filter(None, (self._doubt_of_frames(), self._doubt_of_sizes())))

    def _doubt_of_frames(self) -> str:
        """Return the doubt of the first frame with one, and the number of such frames."""
        doubted = [entry for entry in self.frames if entry.doubt]
        if not doubted:
            return ""
        others = (
            f" (frames in doubt: {len(doubted)} of {len(self.frames)})"
            if len(self.frames) > 1
            else ""
        )
        return f"{doubted[0].label}: {doubted[0].doubt}{others}"

    def _doubt_of_sizes(self) -> str:
        """Fruit look larger or smaller than this kind is, or none has a size."""
        shown = [s.shown[0] / s.fruit.dimensions[[0, 2]].mean() for fruit in self.book.fruit
                 for s in fruit.sightings[:1] if not np.isnan(s.shown[0])]  # fmt: skip
        found = len(self.book.fruit)
        if found >= LEAST_TELLING and self.measured < FEW * found:
            return (
                f"{'only' if self.measured else 'none'} {self.measured or ''}".strip()
                + f" of {found} fruit could be measured: is the depth in millimetres, registered to "
                "colour and of the same moment, and are the fruit as near as the camera measures?"
            )
        if len(shown) < LEAST_TELLING:
            return ""
        kind = self.book.fruit[0].sightings[0].fruit
        middle, (least, most) = float(np.median(shown)), UNLIKE_MODEL
        if kind.sizes is not None:
            usual = kind.sizes.width * kind.sizes.looks / float(kind.dimensions[[0, 2]].mean())
            spread = float(np.hypot(kind.sizes.width_deviation, kind.sizes.looks_deviation))
            # typical relative difference between a kind's known sizes and those of fruit from another place
            apart = 0.15 + 3.0 * spread / np.sqrt(len(shown))
            least, most = usual * np.exp(-apart), usual * np.exp(apart)
        if least <= middle <= most:
            return ""
        return (
            f"the {len(shown)} measured fruit look {middle:.2f} times as large as the model of {kind.name} in the "
            f"middle, {least:.2f} to {most:.2f} is usual: do the intrinsics belong to these pictures, "
            "and is the depth right?"
        )

    def tables(self) -> dict[str, TableView]:
        """Return finds, fruit and sizes as tables, by their topics."""
        measured = sum(entry.measured for entry in self.frames)
        finds = tuple(
            (entry.label, *find_said(s, fruit)) for entry in self.frames for s, fruit in entry.finds
        )
        return {
            "measured": TableView(
                ("frame", *FIND_WORDS), finds, f"{measured} of {self._finds} finds measured"
            ),
            "fruit": TableView(
                FRUIT_WORDS,
                tuple(map(fruit_said, self.book.fruit)),
                f"{len(self.book.fruit)} fruit, each once",
            ),
            "sizes": self.size_classes(),
        }

    def find_rows(self) -> list[tuple[str, ...]]:
        """Return a row for each find, with the columns `FIND_COLUMNS`."""
        return [
            _find_row(entry, sighting, number)
            for entry in self.frames
            for sighting, number in entry.finds
        ]

    def fruit_rows(self) -> list[tuple[str, ...]]:
        """Return a row for each fruit, with the columns `FRUIT_COLUMNS`."""
        return [_fruit_row(fruit) for fruit in self.book.fruit]

    def size_classes(self) -> TableView:
        """How many fruit of each class of width every frame shows, and all of them, each counted once."""
        widths = {entry.label: [width_mm(s.dimensions) for s, _n in entry.finds if s.dimensions is not None]
                  for entry in self.frames if not entry.unreadable}  # fmt: skip
        found = {entry.label: len(entry.finds) for entry in self.frames if not entry.unreadable}
        widths["all, each fruit once"] = [
            width_mm(f.size.dimensions) for f in self.book.fruit if f.size is not None
        ]
        found["all, each fruit once"] = len(self.book.fruit)
        classes = {
            name: [int(width // CLASS_MM) for width in some] for name, some in widths.items()
        }
        there = sorted({each for some in classes.values() for each in some})
        span = range(there[0], there[-1] + 1) if there else range(0)
        names = (f"{CLASS_MM * each}-{CLASS_MM * (each + 1)}" for each in span)
        rows = tuple(
            (name, str(found[name]), str(len(some)), *(str(some.count(each)) for each in span))
            for name, some in classes.items()
        )
        return TableView(("frame", "found", "measured", *names), rows, "widths in mm")

    def picture(self, colour: UInt8) -> ImageView:
        """Return the newest frame with the outline and the row's number of each find."""
        entry = self.frames[-1]
        lines = tuple(
            Line2(
                s.outline,
                str(s.number),
                "found" if s.dimensions is None else "refined",
                closed=True,
            )
            for s, _fruit in entry.finds
        )
        return ImageView(
            colour, lines, caption=f"{entry.label}: {len(lines)} found, {entry.measured} measured"
        )


_SAID = ("width [mm]", "height [mm]", "depth [mm]", "mass [g]")
FIND_WORDS = (
    "row",
    "fruit",
    "score",
    *_SAID,
    "x, y, z [mm]",
    "away [m]",
    "visible",
    "not measured",
)
FRUIT_WORDS = ("fruit", "frames", "score", *_SAID, "x, y, z [mm]", "looks", "not measured")


def find_said(sighting: Sighting, fruit: int) -> tuple[str, ...]:
    """Return a find as texts, with the columns `FIND_WORDS`."""
    guess = "≈ " if sighting.dimensions is None else ""
    return (
        str(sighting.number), str(fruit), f"{sighting.score:.2f}",
        *_said(sighting.fruit, sighting.dimensions, sighting.size_covariance), guess + _place(sighting.p_base),
        f"{guess}{sighting.distance:.2f}", "" if np.isnan(sighting.visibility) else f"{sighting.visibility:.0%}",
        sighting.why,
    )  # fmt: skip


def fruit_said(fruit: KnownFruit) -> tuple[str, ...]:
    """Return a fruit as texts, with the columns `FRUIT_WORDS`."""
    size, kind = fruit.size, fruit.sightings[0].fruit
    said = (
        _said(kind, None, None) if size is None else _said(kind, size.dimensions, size.covariance)
    )
    looks = (
        ""
        if size is None or size.looks < 2
        else f"{size.looks} " + ("agree" if size.agree else "disagree")
    )
    place = ("≈ " if size is None else "") + _place(fruit.place)
    return (
        str(fruit.number),
        str(len(fruit.sightings)),
        f"{fruit.score:.2f}",
        *said,
        place,
        looks,
        fruit.why,
    )


def _said(
    fruit: FruitModel, dimensions: Float64 | None, covariance: Float64 | None
) -> tuple[str, ...]:
    """Return width, height, depth and mass with their 90 % intervals as texts."""
    from_size = _sizes(fruit, dimensions, covariance)
    pairs = (from_size[k : k + 2] for k in range(0, 8, 2))
    return tuple(f"{value} ± {spread}" if value else "" for value, spread in pairs)


def _sizes(
    fruit: FruitModel, dimensions: Float64 | None, covariance: Float64 | None
) -> tuple[str, ...]:
    """Return width, height, depth and mass, each with half its 90 % interval, and the mass's model."""
    if dimensions is None or covariance is None:
        return ("",) * len(_SIZE)
    spreads = Z_90 * np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    said = [
        f"{1e3 * value:.1f}" for pair in zip(dimensions, spreads, strict=True) for value in pair
    ]
    mass = mass_of(fruit, dimensions, covariance)
    weighs = ("", "") if mass is None else (f"{1e3 * mass[0]:.0f}", f"{1e3 * Z_90 * mass[1]:.0f}")
    return (*said, *weighs, mass_model(fruit))


def _find_row(entry: FrameEntry, sighting: Sighting, number: int) -> tuple[str, ...]:
    return (
        entry.label, str(sighting.number), str(number), str(entry.scene), f"{sighting.score:.3f}",
        *_sizes(sighting.fruit, sighting.dimensions, sighting.size_covariance),
        *(f"{1e3 * value:.1f}" for value in sighting.p_base), f"{sighting.distance:.3f}",
        *(f"{value:.0f}" for value in sighting.centre),
        _share(sighting.visibility), _share(sighting.agreeing),
        *("" if np.isnan(value) else f"{value:.2f}" for value in 1e3 * sighting.shown * [1.0, Z_90]),
        "" if np.isnan(sighting.from_side) else f"{sighting.from_side:.3f}", sighting.method, sighting.why,
        entry.doubt,
    )  # fmt: skip


def _fruit_row(fruit: KnownFruit) -> tuple[str, ...]:
    size = fruit.size
    dimensions, covariance = (None, None) if size is None else (size.dimensions, size.covariance)
    return (
        str(fruit.number), str(fruit.scene + 1), str(len(fruit.sightings)), str(0 if size is None else size.looks),
        f"{fruit.score:.3f}", *_sizes(fruit.sightings[0].fruit, dimensions, covariance),
        *(f"{1e3 * value:.1f}" for value in fruit.place),
        "" if size is None or size.looks < 2 else ("yes" if size.agree else "no"), fruit.why,
    )  # fmt: skip


def width_mm(dimensions: Float64) -> float:
    """Return the mean of the two level dimensions [mm]."""
    return 1e3 * float(dimensions[[0, 2]].mean())


def _share(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.2f}"


def _place(p: Float64) -> str:
    return ", ".join(f"{1e3 * value:.0f}" for value in p)


def _without_outlines(entry: FrameEntry) -> FrameEntry:
    finds = tuple(
        (replace(sighting, outline=np.empty((0, 2))), number) for sighting, number in entry.finds
    )
    return replace(entry, finds=finds)
