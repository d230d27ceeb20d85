"""From a finger's voltages to the contact wrench: a small network, read from a file that the fitter wrote.

    voltages − bias → (v − mean) Pᵀ → mapminmax → tansig layers → linear → reverse mapminmax → wrench

The file is JSON; every finger has its own.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pomona.devices.suntouch.codec import TAXELS
from pomona.drivers import DriverError
from pomona.executive import Float64, ReadOnly, read_plain_text

FORMAT = "pomona finger calibration 1"


class UnusableCalibration(DriverError):
    """A calibration file that cannot be used."""

    def __init__(self, path: Path, message: str) -> None:
        self.path = path
        super().__init__(f"{path}: {message}")


@dataclass(frozen=True, slots=True, eq=False)
class FingerCalibration(ReadOnly):
    """The network of one finger."""

    # the finger that it was made for, in words; a left or right among them is compared with the cell file's
    finger: str
    mean: Float64  # mean, components: of the PCA, shapes (25,) [V] and (k, 25)
    components: Float64
    # in_low, in_high: least and greatest of every component in the recording, shape (k,): mapped to −1 … 1
    in_low: Float64
    in_high: Float64
    # weights (m, n) and offsets (m,) of every layer; tansig after each but the last
    layers: tuple[tuple[Float64, Float64], ...]
    # out_low, out_high: least and greatest wrench of the recording, shape (6,) [N, N·m]: the range of −1 … 1
    out_low: Float64
    out_high: Float64
    error_n: float  # root mean square error of the force's components on the held-out part of the recording [N]

    def wrench(self, volts: Float64) -> Float64:
        """Return the force [N] and torque [N·m] on the pad, (..., 6), of voltages without their bias, (..., 25) [V]."""
        x = (volts - self.mean) @ self.components.T
        x = 2.0 * (x - self.in_low) / (self.in_high - self.in_low) - 1.0
        for weights, offsets in self.layers[:-1]:
            x = np.tanh(x @ weights.T + offsets)
        weights, offsets = self.layers[-1]
        y: Float64 = (x @ weights.T + offsets + 1.0) * (
            0.5 * (self.out_high - self.out_low)
        ) + self.out_low
        return y

    @property
    def fingerprint(self) -> str:
        """Of its numbers: a bias belongs to one finger and its calibration."""
        arrays = (
            self.mean,
            self.components,
            self.out_low,
            self.out_high,
            *(w for layer in self.layers for w in layer),
        )
        return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()[:16]

    def other_than(self, side: str) -> bool:
        """Return True if its name has the opposite side (left, right) of the finger, and not this one."""
        words = re.split(r"[^a-z]+", self.finger.lower())
        return side not in words and ("left" if side == "right" else "right") in words

    def save(self, path: Path) -> None:
        """Write the file that `load` reads."""
        content = {
            "format": FORMAT,
            "finger": self.finger,
            "error_n": round(self.error_n, 4),
            "mean": _rounded(self.mean),
            "components": _rounded(self.components),
            "in_low": _rounded(self.in_low),
            "in_high": _rounded(self.in_high),
            "layers": [
                {"weights": _rounded(weights), "offsets": _rounded(offsets)}
                for weights, offsets in self.layers
            ],
            "out_low": _rounded(self.out_low),
            "out_high": _rounded(self.out_high),
        }
        path.write_text(
            json.dumps(content, separators=(",", ":")).replace('],"', '],\n"') + "\n",
            encoding="utf-8",
        )

    @classmethod
    def load(cls, path: Path) -> FingerCalibration:
        """Read a calibration file.

        Raises:
            UnusableCalibration: it is none, or its shapes do not fit each other.
        """
        try:
            content = json.loads(read_plain_text(path))
        except (OSError, ValueError, RecursionError) as error:
            raise UnusableCalibration(path, f"cannot be read: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise UnusableCalibration(
                path, f"is no calibration of a finger (its 'format' must be '{FORMAT}')"
            )
        try:
            calibration = cls(
                str(content["finger"]),
                _array(content["mean"]),
                _array(content["components"]),
                _array(content["in_low"]),
                _array(content["in_high"]),
                tuple(
                    (_array(layer["weights"]), _array(layer["offsets"]))
                    for layer in content["layers"]
                ),
                _array(content["out_low"]),
                _array(content["out_high"]),
                float(content["error_n"]),
            )
            if calibration.mean.shape != (TAXELS,):
                raise ValueError(f"'mean' has the shape {calibration.mean.shape}, not ({TAXELS},)")
            shape = calibration.wrench(np.zeros(TAXELS)).shape
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise UnusableCalibration(path, f"does not fit together: {error}") from error
        if shape != (6,):
            raise UnusableCalibration(path, f"gives {shape} numbers, a wrench has 6")
        return calibration


def _rounded(array: Float64) -> object:
    return np.vectorize(lambda x: float(f"{x:.9g}"))(array).tolist()


def _array(numbers: ArrayLike) -> Float64:
    array = np.asarray(numbers, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError("a number is not finite")
    return array
