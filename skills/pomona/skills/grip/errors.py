"""Errors of the grip's algorithms.

GripError
├── TooFewPushes        a calibration without enough slides
├── UnusablePushes      a file without valid pushes
├── UnusableRate        a sensor that is too slow or too fast
├── UnfitSensor         a sensor that is too coarse, too constant or repeats itself
└── GuidanceEnded       guided pushes at a cell that were ended
"""

from __future__ import annotations


class GripError(Exception):
    """Root of these errors."""


class TooFewPushes(GripError):
    """A calibration needs more slides."""

    def __init__(self, found: int) -> None:
        self.found = found
        super().__init__(
            f"only {found} usable slides were found, at least 3 are needed: hold the fruit with a steady force of more"
            " than 0.6 N and pull or twist it until it slides, at two forces or more"
        )


class UnusablePushes(GripError):
    """The file of pushes cannot be read."""


class GuidanceEnded(GripError):
    """Guided pushes cannot begin or continue."""


class UnusableRate(GripError):
    """The sample rate of a force sensor is too low or too high for a grip."""

    def __init__(self, rate: float, rates: tuple[float, float]) -> None:
        self.rate, self.rates = rate, rates
        super().__init__(
            f"the force sensor gives {rate:g} samples a second; a grip needs {rates[0]:g} to {rates[1]:g}: set the"
            " sensor's rate in the cell file"
        )


class UnfitSensor(GripError):
    """The samples with nothing touching show that a force sensor cannot control a grip.

    Attributes:
        measured, expected: value and bound of the faulty quantity, in SI units.
    """

    def __init__(self, message: str, measured: float, expected: float) -> None:
        self.measured, self.expected = measured, expected
        super().__init__(message)
