"""Fits a finger's calibration to recorded voltages and wrenches (`pomona calibrate fingers`)."""

from __future__ import annotations

import io
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.codec import TAXELS
from pomona.drivers import DriverError
from pomona.executive import Float64, read_plain_arrays, read_plain_text

BLOCKS = 50
STEPS = 10  # steps of L-BFGS in an epoch
_PATIENCE = 10 * STEPS  # steps without a lower error after which the fit ends
UNEXPLAINED = 0.5  # of a force's variance on the samples kept aside; more is no measurement of it
MOST_BYTES = 1 << 28  # of a recording as text; twenty thousand samples have 10 MB


class UnusableRecording(DriverError):
    """A recording that no calibration can be fitted to."""


@dataclass(frozen=True, slots=True, eq=False)
class FitReport:
    """Errors of the calibration on the held-out part."""

    samples: int  # recorded pairs, held-out ones included
    rms: Float64  # rms, worst: error of each component, shape (6,) [N, N·m]
    worst: Float64
    within: float  # ratio of the pairs with a force error below 0.2 N in every component

    def __str__(self) -> str:
        names = ("f_x", "f_y", "f_z", "tau_x", "tau_y", "tau_z")
        lines = [f"fitted to {self.samples} samples; on the fifth that was kept aside:"]
        for i, name in enumerate(names):
            scale, unit = (1.0, "N") if i < 3 else (1e3, "mN·m")
            lines.append(
                f"  {name:5}  rms {scale * self.rms[i]:7.3f} {unit:5} worst {scale * self.worst[i]:7.3f} {unit}"
            )
        return "\n".join([*lines, f"  {100.0 * self.within:.1f} % within 0.2 N"])


def read_recording(path: Path) -> tuple[Float64, Float64]:
    """Voltages (n, 25) [V] and wrenches (n, 6) [N, N·m] of a recording.

    Either .npz with the arrays `volts` and `wrenches`, or .csv with 31 numbers a line: 25 voltages, then the wrench.

    Raises:
        UnusableRecording: it is neither.
    """
    try:
        if path.suffix == ".npz":
            arrays = read_plain_arrays(path)
            volts = np.asarray(arrays["volts"], float)
            wrenches = np.asarray(arrays["wrenches"], float)
        else:
            text = read_plain_text(path, MOST_BYTES)
            if not text.strip():
                raise ValueError("it is empty")
            table = np.loadtxt(io.StringIO(text), delimiter=",", comments="#", ndmin=2)
            volts = table[:, :TAXELS]
            wrenches = table[:, TAXELS:]
    except (OSError, ValueError, KeyError, IndexError, TypeError) as error:
        raise UnusableRecording(f"{path}: cannot be read: {error}") from error
    if volts.ndim != 2 or volts.shape[1] != TAXELS or wrenches.shape != (len(volts), 6):
        raise UnusableRecording(
            f"{path}: needs (n, 25) voltages and (n, 6) wrenches, not {volts.shape}, {wrenches.shape}"
        )
    if not (len(volts) and np.isfinite(volts).all() and np.isfinite(wrenches).all()):
        raise UnusableRecording(f"{path}: holds no samples, or some that are no finite numbers")
    return volts, wrenches


def fit_calibration(
    volts: Float64,
    wrenches: Float64,
    finger: str,
    *,
    components: int = TAXELS,
    hidden: tuple[int, ...] = (32,),
    epochs: int = 300,
    seed: int = 0,
) -> tuple[FingerCalibration, FitReport]:
    """Fit the network to a recording.

    Args:
        volts: voltages without their bias, shape (n, 25) [V]; a whole recording, in the order of time.
        wrenches: simultaneous measurements of a reference sensor, in the pad's frame, shape (n, 6) [N, N·m].
        components, hidden: of the PCA that are kept, and sizes of the tansig layers.
        epochs: times `STEPS` steps of L-BFGS; ends earlier when the error on the samples kept aside no longer falls.

    Raises UnusableRecording: too few samples, no variation, values that are not finite, or forces that the voltages do
    not explain.
    """
    if len(volts) < 500 or volts.shape[1:] != (TAXELS,) or wrenches.shape != (len(volts), 6):
        raise UnusableRecording(
            f"needs at least 500 samples of 25 voltages and 6 components, not {volts.shape}"
        )
    if not (np.isfinite(volts).all() and np.isfinite(wrenches).all()):
        raise UnusableRecording("the recording holds values that are not finite")
    if np.ptp(wrenches, axis=0).min() == 0.0 or np.ptp(volts, axis=0).max() == 0.0:
        raise UnusableRecording(
            "a component of the wrench, or every voltage, never changes in the recording"
        )
    aside = _kept_aside(len(volts), seed)
    mean = volts[~aside].mean(axis=0)
    _, _, directions = np.linalg.svd(volts[~aside] - mean, full_matrices=False)
    basis = directions[:components]
    x = (volts - mean) @ basis.T
    in_low = x[~aside].min(axis=0)
    in_high = x[~aside].max(axis=0)
    out_low = wrenches[~aside].min(axis=0)
    out_high = wrenches[~aside].max(axis=0)
    scaled_x = 2.0 * (x - in_low) / (in_high - in_low) - 1.0
    scaled_y = 2.0 * (wrenches - out_low) / (out_high - out_low) - 1.0
    layers = _train(scaled_x, scaled_y, aside, hidden, epochs, seed)
    calibration = FingerCalibration(
        finger, mean, basis, in_low, in_high, layers, out_low, out_high, 0.0
    )
    error = np.abs(calibration.wrench(volts[aside]) - wrenches[aside])
    rms = np.sqrt((error**2).mean(axis=0))
    unexplained = (rms / (wrenches[aside] - wrenches[~aside].mean(axis=0)).std(axis=0))[:3] ** 2
    if unexplained.max() > UNEXPLAINED:
        worst = int(unexplained.argmax())
        raise UnusableRecording(
            f"the voltages explain {max(0.0, 1.0 - unexplained[worst]):.0%} of the variance of f_{'xyz'[worst]}, "
            f"{1.0 - UNEXPLAINED:.0%} are needed: they belong to another sensor or time, or the fit ended too early"
        )
    report = FitReport(
        len(volts), rms, error.max(axis=0), float((error[:, :3].max(axis=1) < 0.2).mean())
    )
    force_error = float(np.sqrt((rms[:3] ** 2).mean()))
    return (
        FingerCalibration(
            finger, mean, basis, in_low, in_high, layers, out_low, out_high, force_error
        ),
        report,
    )


def _kept_aside(count: int, seed: int) -> NDArray[np.bool_]:
    """Whole blocks of time: neighbouring samples are too alike to test each other."""
    block = np.minimum(np.arange(count) * BLOCKS // count, BLOCKS - 1)
    # share of the recording, in blocks, on which the error is measured
    chosen = np.random.default_rng(seed).permutation(BLOCKS)[: round(0.2 * BLOCKS)]
    return np.isin(block, chosen)


def _train(
    x: Float64,
    y: Float64,
    aside: NDArray[np.bool_],
    hidden: tuple[int, ...],
    epochs: int,
    seed: int,
) -> tuple[tuple[Float64, Float64], ...]:
    """Return weights (outputs, inputs) and biases of each layer, by L-BFGS on the mean squared error."""
    from scipy.optimize import minimize  # a third of a second to import, and no driver needs it

    rng = np.random.default_rng(seed)
    shapes = list(itertools.pairwise((x.shape[1], *hidden, y.shape[1])))
    start = [
        np.concatenate([rng.standard_normal(fan_in * fan_out) / fan_in**0.5, np.zeros(fan_out)])
        for fan_in, fan_out in shapes
    ]
    best = float("inf")
    best_parameters = np.concatenate(start)
    stale = 0

    def watch(parameters: Float64) -> None:
        nonlocal best, best_parameters, stale
        now, _ = _error(_layers(parameters, shapes), x[aside], y[aside])
        if now < best * 0.999:
            best = now
            best_parameters = parameters.copy()
            stale = 0
            return
        stale += 1
        if stale >= _PATIENCE:
            raise StopIteration

    minimize(
        lambda parameters: _error(_layers(parameters, shapes), x[~aside], y[~aside]),
        best_parameters,
        jac=True,
        method="L-BFGS-B",
        callback=watch,
        options={
            "maxiter": epochs * STEPS,
            "maxfun": 2 * epochs * STEPS,
            "maxcor": 30,
            "ftol": 0.0,
            "gtol": 1e-9,
        },
    )
    return tuple(_layers(best_parameters, shapes))


def _layers(parameters: Float64, shapes: list[tuple[int, int]]) -> list[tuple[Float64, Float64]]:
    layers = []
    begin = 0
    for fan_in, fan_out in shapes:
        end = begin + fan_in * fan_out
        layers.append(
            (parameters[begin:end].reshape(fan_out, fan_in), parameters[end : end + fan_out])
        )
        begin = end + fan_out
    return layers


def _error(layers: list[tuple[Float64, Float64]], x: Float64, y: Float64) -> tuple[float, Float64]:
    """Return the mean squared error of the network's answers and its gradient, as flat as the parameters."""
    activations = [x]
    for weights, bias in layers[:-1]:
        activations.append(np.tanh(activations[-1] @ weights.T + bias))
    residual = activations[-1] @ layers[-1][0].T + layers[-1][1] - y
    slope = 2.0 / residual.size * residual
    gradient = []
    for (weights, _), inputs in zip(reversed(layers), reversed(activations), strict=True):
        gradient += [slope.sum(axis=0), (slope.T @ inputs).ravel()]
        slope = (slope @ weights) * (1.0 - inputs**2)
    return float((residual**2).mean()), np.concatenate(gradient[::-1])
