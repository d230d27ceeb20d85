"""Fits a finger's calibration to recorded voltages and wrenches (`pomona calibrate fingers`)."""

from __future__ import annotations

import io
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.errors import DriverError
from pomona.drivers.suntouch.calibration import FingerCalibration
from pomona.drivers.suntouch.codec import TAXELS
from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_arrays import read_plain_arrays
from pomona.executive.values.plain_text import read_plain_text

KEPT_ASIDE = 0.2
"""Share of the recording, in blocks, on which the error is measured."""
BLOCKS = 50
MOST_BYTES = 1 << 28
"""Of a recording as text; twenty thousand samples have 10 MB."""


class UnusableRecording(DriverError):
    """A recording that no calibration can be fitted to."""


@dataclass(frozen=True, slots=True, eq=False)
class FitReport:
    """How well the calibration does on what was kept aside.

    Attributes:
        samples: recorded pairs, those kept aside included.
        rms, worst: error of each component, shape (6,) [N, N·m].
        within: share of the pairs whose force is right to 0.2 N in every component.
    """

    samples: int
    rms: Float64
    worst: Float64
    within: float

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
            volts, wrenches = np.asarray(arrays["volts"], float), np.asarray(arrays["wrenches"], float)
        else:
            text = read_plain_text(path, MOST_BYTES)
            if not text.strip():
                raise ValueError("it is empty")
            table = np.loadtxt(io.StringIO(text), delimiter=",", comments="#", ndmin=2)
            volts, wrenches = table[:, :TAXELS], table[:, TAXELS:]
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
        wrenches: what a reference sensor measured meanwhile, in the pad's frame, shape (n, 6) [N, N·m].
        finger: which finger it is, for people.
        components: of the PCA that are kept.
        hidden: sizes of the tansig layers.
        epochs: outer steps of L-BFGS; ends earlier when the error on what is kept aside no longer falls.

    Raises:
        UnusableRecording: too few samples, no variation, or values that are not finite.
    """
    if len(volts) < 500 or volts.shape[1:] != (TAXELS,) or wrenches.shape != (len(volts), 6):
        raise UnusableRecording(f"needs at least 500 samples of 25 voltages and 6 components, not {volts.shape}")
    if not (np.isfinite(volts).all() and np.isfinite(wrenches).all()):
        raise UnusableRecording("the recording holds values that are not finite")
    if np.ptp(wrenches, axis=0).min() == 0.0 or np.ptp(volts, axis=0).max() == 0.0:
        raise UnusableRecording("a component of the wrench, or every voltage, never changes in the recording")
    aside = _kept_aside(len(volts), seed)
    mean = volts[~aside].mean(axis=0)
    _, _, directions = np.linalg.svd(volts[~aside] - mean, full_matrices=False)
    basis = directions[:components]
    x = (volts - mean) @ basis.T
    in_low, in_high = x[~aside].min(axis=0), x[~aside].max(axis=0)
    out_low, out_high = wrenches[~aside].min(axis=0), wrenches[~aside].max(axis=0)
    scaled_x = 2.0 * (x - in_low) / (in_high - in_low) - 1.0
    scaled_y = 2.0 * (wrenches - out_low) / (out_high - out_low) - 1.0
    layers = _train(scaled_x, scaled_y, aside, hidden, epochs, seed)
    calibration = FingerCalibration(finger, mean, basis, in_low, in_high, layers, out_low, out_high, 0.0)
    error = np.abs(calibration.wrench(volts[aside]) - wrenches[aside])
    rms = np.sqrt((error**2).mean(axis=0))
    report = FitReport(len(volts), rms, error.max(axis=0), float((error[:, :3].max(axis=1) < 0.2).mean()))
    force_error = float(np.sqrt((rms[:3] ** 2).mean()))
    return (
        FingerCalibration(finger, mean, basis, in_low, in_high, layers, out_low, out_high, force_error),
        report,
    )


def _kept_aside(count: int, seed: int) -> NDArray[np.bool_]:
    """Whole blocks of time: neighbouring samples are too alike to test each other."""
    block = np.minimum(np.arange(count) * BLOCKS // count, BLOCKS - 1)
    chosen = np.random.default_rng(seed).permutation(BLOCKS)[: round(KEPT_ASIDE * BLOCKS)]
    return np.isin(block, chosen)


def _train(
    x: Float64, y: Float64, aside: NDArray[np.bool_], hidden: tuple[int, ...], epochs: int, seed: int
) -> tuple[tuple[Float64, Float64], ...]:
    import torch  # takes a second to import, and no driver needs it

    generator = torch.Generator().manual_seed(seed)
    sizes = (x.shape[1], *hidden, y.shape[1])
    parameters = []
    for fan_in, fan_out in itertools.pairwise(sizes):
        weights = torch.randn(fan_out, fan_in, dtype=torch.float64, generator=generator) / fan_in**0.5
        parameters += [weights.requires_grad_(), torch.zeros(fan_out, dtype=torch.float64, requires_grad=True)]

    def error(inputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        for i in range(0, len(parameters) - 2, 2):
            inputs = torch.tanh(inputs @ parameters[i].T + parameters[i + 1])
        residual: torch.Tensor = inputs @ parameters[-2].T + parameters[-1] - targets
        return (residual**2).mean()

    train = torch.from_numpy(x[~aside]), torch.from_numpy(y[~aside])
    test = torch.from_numpy(x[aside]), torch.from_numpy(y[aside])
    optimiser = torch.optim.LBFGS(parameters, max_iter=10, history_size=30, line_search_fn="strong_wolfe")

    def closure() -> torch.Tensor:
        optimiser.zero_grad()
        loss = error(*train)
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    best, best_parameters, stale = float("inf"), [p.detach().clone() for p in parameters], 0
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # the matrices are too small to be shared
    try:
        for _ in range(epochs):
            optimiser.step(closure)  # type: ignore[no-untyped-call]
            with torch.no_grad():
                now = float(error(*test))
            if now < best * 0.999:
                best, best_parameters, stale = now, [p.detach().clone() for p in parameters], 0
            else:
                stale += 1
                if stale >= 10:
                    break
    finally:
        torch.set_num_threads(threads)
    arrays = [p.numpy() for p in best_parameters]
    return tuple((arrays[i], arrays[i + 1]) for i in range(0, len(arrays), 2))
