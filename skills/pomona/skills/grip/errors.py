"""What can go wrong with a grip's algorithms.

GripError
├── TooFewPushes        a calibration without enough slides
├── UnusablePushes      a file that holds no pushes
├── UnusableRate        a sensor that is too slow or too fast
├── UnfitSensor         a sensor that is too coarse, too constant or repeats itself
└── GuidanceEnded       pushes at a cell that cannot be made
"""

from __future__ import annotations


class GripError(Exception):
    """Root of what the grip's algorithms raise on purpose."""


class TooFewPushes(GripError):
    """A calibration needs more slides."""

    def __init__(self, found: int) -> None:
        self.found = found
        super().__init__(
            f"only {found} usable slides were found, at least 3 are needed: hold the fruit with a steady force of more"
            " than 0.6 N and pull or twist it until it slides, at two forces or more"
        )


class UnusablePushes(GripError):
    """A file of pushes cannot be read."""


class GuidanceEnded(GripError):
    """Pushes at a cell cannot be made, or not be gone on with."""


class UnusableRate(GripError):
    """A force sensor samples too slowly or too fast for a grip."""

    def __init__(self, rate: float, rates: tuple[float, float]) -> None:
        self.rate, self.rates = rate, rates
        super().__init__(
            f"the force sensor gives {rate:g} samples a second; a grip needs {rates[0]:g} to {rates[1]:g}: set the"
            " sensor's rate in the cell file"
        )


class UnfitSensor(GripError):
    """A force sensor whose samples with nothing touching show that it cannot control a grip.

    Attributes:
        measured, expected: of the quantity that is wrong, in SI units; `expected` is its bound.
    """

    def __init__(self, message: str, measured: float, expected: float) -> None:
        self.measured, self.expected = measured, expected
        super().__init__(message)
