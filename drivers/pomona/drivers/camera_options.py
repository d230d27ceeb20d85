"""Options for a camera's intrinsics in cell files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.kinds import Measure, Whole
from pomona.executive.values.sections import Problem, value
from pomona.executive.values.units import PIXELS

LARGEST = 100_000  # no image is wider or higher [px]
LEAST_FOCAL = 0.1  # of a pinhole camera, as a share of its image's width: it would see 157°
MOST_OBLONG = 1.25  # no camera's pixels are higher than wide by this factor, or wider than high


@dataclass(frozen=True, slots=True, kw_only=True)
class IntrinsicsSection:
    """A pinhole camera's intrinsics, and the size of the image for which they hold."""

    fx: float = value(Measure(PIXELS, "1 px"), help="focal length along the rows")
    fy: float = value(Measure(PIXELS, "1 px"), help="focal length along the columns")
    cx: float = value(Measure(PIXELS, "0 px"), help="column of the principal point")
    cy: float = value(Measure(PIXELS, "0 px"), help="row of the principal point")
    width: int = value(Whole(1, LARGEST), help="of the image")
    height: int = value(Whole(1, LARGEST), help="of the image")

    def problems(self) -> Iterator[Problem]:
        for key, at, size in (("cx", self.cx, self.width), ("cy", self.cy, self.height)):
            if at > size:
                yield Problem(key, f"it is {at:g} px, outside an image of {size} pixels")
        if self.fx < LEAST_FOCAL * self.width:
            yield Problem(
                "fx", f"it is {self.fx:g} px in an image of {self.width} px: is it in mm?"
            )
        if not 1.0 / MOST_OBLONG <= self.fx / self.fy <= MOST_OBLONG:
            yield Problem(
                "fx",
                f"it is {self.fx:g} px and fy is {self.fy:g} px: a camera's are nearly the same",
            )

    def intrinsics(self, size: tuple[int, ...] | None = None) -> Intrinsics:
        """Return the intrinsics of the same view in an image of another size (width, height)."""
        width, height = size or (self.width, self.height)
        return scaled(
            Intrinsics(self.fx, self.fy, self.cx, self.cy, self.width, self.height), width, height
        )


def scaled(of: Intrinsics, width: int, height: int) -> Intrinsics:
    """Return the intrinsics of the same view in an image of another size [px]."""
    x = width / of.width
    y = height / of.height
    if (x, y) == (1.0, 1.0):
        return of
    # Pixel centres lie at integers: an image's left edge is at -0.5, however many pixels it has.
    cx = (of.cx + 0.5) * x - 0.5
    cy = (of.cy + 0.5) * y - 0.5
    return Intrinsics(of.fx * x, of.fy * y, cx, cy, width, height)
