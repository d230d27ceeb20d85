"""Error model of a camera's depth: one for every sensor, from its driver or from a file beside its frames.

A depth z [m] differs from the truth by

    random     z² · disparity / (f · baseline) of a stereo camera, growth · z² of time of flight, and a floor;
    slant      lateral · z / f · tan(angle): a pixel's ray is displaced, and a slanted surface is nearer there;
    the whole  offset + scale · z, which `corrected` subtracts, and their uncertainty;
    edges      pixels beside a step in depth have a value between its two sides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import Measure, Number, Text, choose
from pomona.executive.values.sections import Problem, value
from pomona.executive.values.units import LENGTH, PIXELS

_HALFWAY = float(np.tan(np.radians(30.0)))
_PIXEL = float(
    1.0 / np.sqrt(12.0)
)  # standard deviation of an outline's position within its pixel [px]


@dataclass(frozen=True, slots=True)
class DepthModel:
    """Error model of one sensor's depth.

    Attributes:
        disparity: standard deviation of a stereo camera's disparity [px]; 0 for a camera of another kind.
        baseline: distance of the stereo camera's imagers [m].
        growth: standard deviation at 1 m that grows with the square of the distance [m / m²]: time of flight.
        floor: standard deviation at any distance [m].
        lateral: standard deviation of a pixel's ray, from its footprint [px].
        registration: offset between depth and colour in either direction, the same for all pixels of a fruit, standard
            deviation [px].
        alike: number of neighbouring pixels with a common error, from a matching window or one pixel of the sensor.
        edge: number of pixels on the far side of a step in depth that mix both sides.
        offset, scale: the depth is too long by offset + scale · z [m, 1].
        offset_deviation, scale_deviation: standard deviations of these two, the same in all pixels [m, 1].
    """

    disparity: float = 0.0
    baseline: float = 0.05
    growth: float = 0.0
    floor: float = 0.0
    lateral: float = 0.0
    registration: float = 0.0
    alike: float = 12.0
    edge: int = 0
    offset: float = 0.0
    offset_deviation: float = 0.0
    scale: float = 0.0
    scale_deviation: float = 0.0

    def deviation(self, z: Float64, focal: float) -> Float64:
        """Random error of a pixel that faces the camera [m], at depths z [m] of any shape, for a focal length [px]."""
        grown: Float64 = z**2 * (self.disparity / (focal * self.baseline) + self.growth)
        return grown if self.floor == 0.0 else np.hypot(grown, self.floor)

    def beside(self, z: Float64, focal: float) -> Float64:
        """Return the standard deviation of where a pixel looks, across its ray, at depths z of any shape [m]."""
        aside: Float64 = self.lateral * z / focal
        return aside

    def agreeing(self, z: Float64, focal: float) -> Float64:
        """By how much the depth of a fruit may differ from a model that is right, at depths z of any shape [m].

        The standard deviation, where the surface is turned away as halfway between a ball's middle and its outline.
        """
        moved = _HALFWAY * np.hypot(self.lateral, self.registration) * z / focal
        apart: Float64 = np.hypot(self.deviation(z, focal), moved)
        return apart

    def outline(self, z: float, focal: float) -> float:
        """Return the standard deviation of a width between two outlines [m], at a depth z [m]; focal [px]."""
        return float(np.sqrt(2.0) * np.hypot(self.lateral, _PIXEL) * z / focal)

    def of_the_whole(self, z: float) -> float:
        """Return the standard deviation of the error that all pixels at a depth z [m] have in common, in units of z."""
        return float(np.hypot(self.scale_deviation, self.offset_deviation / max(z, 1e-3)))

    def corrected(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return depth of any shape without the sensor's offset and scale [m]; unmeasured pixels stay 0."""
        if self.offset == self.scale == 0.0:
            return depth
        true = (depth - np.float32(self.offset)) / np.float32(1.0 + self.scale)
        return np.where(depth > 0.0, np.maximum(true, 0.0), depth).astype(np.float32)


D4XX = DepthModel(disparity=0.08, baseline=0.05, lateral=0.5, scale_deviation=0.0115)
"""RealSense D4xx stereo, the default for frames without a model. 0.08 px is an empirical number: the advice of A.
Grunnet-Jepsen of Intel for an arbitrary scene, beside 0.032 px for a well calibrated camera and a well textured scene
(librealsense, issue 3904). The scale is within the 2 % at 2 m of the data sheet, evenly spread. `lateral` is half a
pixel, not measured."""

AZURE_KINECT = DepthModel(
    growth=0.8e-3,
    lateral=0.5,
    registration=5.0,
    alike=4.0,
    edge=2,
    offset_deviation=6.4e-3,
    scale_deviation=0.6e-3,
)
"""Azure Kinect, narrow field unbinned, registered to 1920 x 1080. Growth and `lateral` were measured in two frames of
an orchard row: residuals of 26 000 smooth patches of 11 x 11 px at 0.9 to 1.8 m are 0.8 mm · z² where they face the
camera and 0.45 to 0.5 px · z / f · tan(angle) more where they do not. `registration` is the offset of 12 outlines of
fruit and balls between colour and depth (root mean square of either direction). One pixel of its depth is 3.3 of the
colour image. Offset and scale lie within the maker's 11 mm and 0.1 % of the distance, evenly spread (confirmed by
Tölgyessy et al. 2021)."""

SIMULATED = DepthModel(
    disparity=0.08, baseline=0.05
)  # stereo noise alone: simulated pixels look where they should

SENSORS = {"d4xx": D4XX, "azure_kinect": AZURE_KINECT, "simulated": SIMULATED}


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthModelSection:
    """Error model of a camera's depth: a known sensor, and better values for this camera."""

    sensor: str = value(Text(), "d4xx", "one that is known: " + ", ".join(SENSORS))
    disparity: float | None = value(
        Measure(PIXELS, "0 px", "10 px"), None, "standard deviation of the disparity"
    )
    baseline: float | None = value(
        Measure(LENGTH, "1 mm", "1 m"), None, "distance of a stereo camera's imagers"
    )
    growth: float | None = value(
        Measure(LENGTH, "0 mm", "100 mm"), None, "deviation at 1 m; grows with the square"
    )
    floor: float | None = value(
        Measure(LENGTH, "0 mm", "100 mm"), None, "standard deviation at any distance"
    )
    lateral: float | None = value(
        Measure(PIXELS, "0 px", "50 px"), None, "deviation of where a pixel looks"
    )
    registration: float | None = value(
        Measure(PIXELS, "0 px", "50 px"), None, "misalignment of depth and colour"
    )
    alike: float | None = value(
        Number(1.0, 1000.0), None, "number of neighbouring pixels with a common error"
    )
    edge: float | None = value(
        Measure(PIXELS, "0 px", "50 px"), None, "width of the mixed pixels at a step in depth"
    )
    offset: float | None = value(
        Measure(LENGTH, "-1 m", "1 m"), None, "the depth is too long by this everywhere"
    )
    offset_deviation: float | None = value(
        Measure(LENGTH, "0 mm", "1 m"), None, "standard deviation of the offset"
    )
    scale: float | None = value(Number(-0.5, 0.5), None, "the depth is too long by this share")
    scale_deviation: float | None = value(Number(0.0, 0.5), None, "standard deviation of the scale")

    def problems(self) -> Iterator[Problem]:
        if self.sensor not in SENSORS:
            yield Problem("sensor", f"'{self.sensor}' is not known", choose(self.sensor, SENSORS))
        elif self.model() == replace(self.model(), disparity=0.0, growth=0.0, floor=0.0):
            yield Problem(
                "disparity",
                "no camera is without noise",
                "write 'disparity' [px], 'growth' or 'floor' [mm]",
            )

    def model(self) -> DepthModel:
        """For the camera's frames."""
        known = SENSORS[self.sensor]
        said = {
            f.name: getattr(self, f.name)
            for f in fields(known)
            if getattr(self, f.name) is not None
        }
        if "edge" in said:
            said["edge"] = round(said["edge"])
        return replace(known, **said)


def depth_model_of(said: DepthModelSection | None, nominal: DepthModel = D4XX) -> DepthModel:
    """Return a file's model of a camera's depth, or the nominal one."""
    return said.model() if said else nominal
