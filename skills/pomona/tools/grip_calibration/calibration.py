"""Friction and stiffness of a grip from pushes: hold a fruit with a steady force, pull or twist it until it slides.

While it slides, the load lies on the limit surface of the normal force. A few pushes at different forces, some with a
twist, therefore give mu, delta and gamma; a slow squeeze gives the stiffness of the pads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares

from pomona.drivers.interfaces import WrenchSample
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.grip import GripError
from pomona.skills.grip.limit_surface import SoftContact, least_force
from pomona.skills.grip.pads import MIRROR, PAD_HALF, loads_of_finger
from pomona.skills.grip.settings import ForceLoopSettings


class TooFewPushes(GripError):
    """A calibration needs more slides."""

    def __init__(self, found: int) -> None:
        self.found = found
        super().__init__(
            f"only {found} usable slides were found, at least 3 are needed: hold the fruit with a steady force of more"
            " than 0.6 N and pull or twist it until it slides, at two forces or more"
        )


class GuidanceEnded(GripError):
    """Guided pushes cannot begin or continue."""


WINDOW = 25  # samples of the average over a push: 50 ms
SLIDING_SHARE = 0.05  # most loaded fraction of a push, where the fruit slid
FEW = 10  # samples of the average of the present force
LEAST_FORCE = 0.3  # smallest normal force of a finger's usable sample [N]
# lever with which moments count as forces when the most loaded samples are chosen [m]
TYPICAL_RADIUS = 0.005
SPREAD = 1.5  # smallest ratio of the pushes' forces from which gamma is fitted

GROWTH_STD = 0.15
SLIDE_STD = 0.05
"""Assumed standard deviations of gamma among fruit, and of the logarithm of a slide's force: with noisy slides gamma
stays near the assumed value."""

# relative error of a slide that is left out, and largest part of those
OUTLIER = 0.25
MOST_OUTLIERS = 0.34
VAGUE = 0.25  # relative uncertainty of the contact radius above which a note is written


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """One recorded push or squeeze."""

    wrenches: Float64  # of both pads with the bias removed, shape (n, 2, 6), in order, as in `WrenchSample`
    width: Float64  # opening between the pads' faces, shape (n,) [m]; NaN where it is unknown


BIAS_SAMPLES = 100  # number of first samples of a stream whose mean is the bias


class PushRecorder:
    """Records a live stream as pushes: `sensor.subscribe(recorder.on_sample)`.

    The first samples give the bias: nothing may touch the fingers until `ready`.
    """

    def __init__(self, width: Callable[[], float] | None = None) -> None:
        self._width = width
        self._wrenches: list[Float64] = []
        self._widths: list[float] = []
        self._bias: Float64 | None = None
        self.stamp = -np.inf

    def on_sample(self, sample: WrenchSample) -> None:
        """Keep one sample, unless it is saturated or not finite."""
        if any(sample.saturated) or not np.isfinite(sample.wrenches).all():
            return
        self.stamp = sample.stamp
        self._wrenches.append(np.array(sample.wrenches))
        self._widths.append(self._width() if self._width is not None else np.nan)

    @property
    def ready(self) -> bool:
        """True when the bias is known."""
        return len(self._wrenches) >= BIAS_SAMPLES

    @property
    def received(self) -> int:
        """Number of samples kept so far."""
        return len(self._wrenches)

    def grasp_force(self) -> float:
        """Return the grip force of the last few samples [N]; 0 before the bias is known."""
        if len(self._wrenches) <= BIAS_SAMPLES:
            return 0.0
        if self._bias is None:
            self._bias = np.array(self._wrenches[:BIAS_SAMPLES]).mean(axis=0)
        pressing = -(np.array(self._wrenches[-FEW:]).mean(axis=0) - self._bias)[:, 2]
        return 2.0 * float(pressing.min())

    def push(self, start: int | None = None) -> Push:
        """Return the samples since the bias, or from number `start` on, with the bias removed.

        Raises TooFewPushes: the bias is not known yet.
        """
        if not self.ready:
            raise TooFewPushes(0)
        received = np.array(self._wrenches)
        widths = np.array(self._widths)
        n = BIAS_SAMPLES
        first = max(n, start or n)
        return Push(received[first:] - received[:n].mean(axis=0), widths[first:])


@dataclass(frozen=True, slots=True)
class GripCalibration:
    """Grip parameters from pushes, and their quality."""

    contact: SoftContact  # mu, delta, gamma; k is given
    mu_std: float  # mu_std, delta_std, gamma_std: standard errors of the fit; gamma_std is 0 where gamma was not fitted
    delta_std: float
    gamma_std: float
    residual: (
        float  # root mean square of the relative error of the normal force at which the fruit slid
    )
    pushes: int  # number of slides (one of each finger in a push)
    stiffness: float | None  # grip force per metre of closing [N/m], or None without a squeeze
    stiffness_r2: float  # fraction of the squeeze's variance that a straight line explains
    notes: tuple[str, ...]  # limits of the result, as sentences

    def __str__(self) -> str:
        contact = self.contact
        lines = [
            f"mu     {contact.mu:.3f} ± {self.mu_std:.3f}",
            f"delta  {1e3 * contact.delta:.3f} ± {1e3 * self.delta_std:.3f} mm",
            f"gamma  {contact.gamma:.3f} ± {self.gamma_std:.3f}",
            f"fit    {100.0 * self.residual:.1f} % of the force over {self.pushes} slides",
        ]
        if self.stiffness is not None:
            lines.append(f"pads   {self.stiffness:.0f} N/m, R² {self.stiffness_r2:.4f}")
        return "\n".join([*lines, *(f"note   {note}" for note in self.notes)])


def calibrate_grip(
    pushes: list[Push], squeeze: Push | None = None, start: SoftContact | None = None
) -> GripCalibration:
    """Fit friction to pushes, and stiffness to a squeeze.

    Args:
        pushes: each with a slide; at two grip forces or more, some with a twist.
        squeeze: slow closing on the fruit.
        start: start of the fit, with k, and with gamma where the pushes do not determine it.

    Raises TooFewPushes: fewer than three usable slides.
    """
    start = start or SoftContact()
    f_n, f_t, tau_n = _slides(pushes)
    if len(f_n) < 3:
        raise TooFewPushes(len(f_n))
    fit = _ContactFit(f_n, f_t, tau_n, start)
    contact, std, error = fit.solve()
    stiffness, r2 = _stiffness(squeeze) if squeeze is not None else (None, 0.0)
    if stiffness is not None and r2 < 0.98:
        fit.notes.append("the squeeze is not a straight line: the pads stiffen or the fruit moved")
    residual = float(np.sqrt(np.mean(error**2)))
    if residual > 0.1:
        fit.notes.append(
            "the pushes disagree with each other by more than 10 %: repeat them more slowly"
        )
    return GripCalibration(
        contact=contact,
        mu_std=float(std[0] * contact.mu),
        delta_std=float(std[1] * contact.delta),
        gamma_std=float(std[2]),
        residual=residual,
        pushes=len(error),
        stiffness=stiffness,
        stiffness_r2=r2,
        notes=tuple(fit.notes),
    )


class _ContactFit:
    """Least squares of ln mu, ln of the contact's radius, and gamma, as far as the slides determine them.

    Args:
        f_n, f_t, tau_n: of each slide, shape (n,) [N, N, N·m].
        start: start of the fit, and values that are not fitted.
    """

    def __init__(self, f_n: Float64, f_t: Float64, tau_n: Float64, start: SoftContact) -> None:
        self.notes: list[str] = []
        self._f_n = f_n
        self._f_t = f_t
        self._tau_n = tau_n
        self._start = start
        self._agrees = np.ones(len(f_n), bool)
        twisted = tau_n / np.maximum(f_t, 1e-6) > 0.2 * TYPICAL_RADIUS
        knows_torsion = bool(twisted.any())
        knows_growth = bool(f_n.max() / f_n.min() > SPREAD and twisted.sum() >= 3)
        if not knows_torsion:
            self.notes.append("no push twisted the fruit: delta and gamma are the assumed ones")
        elif not knows_growth:
            self.notes.append("the pushes' forces lie too close together: gamma is the assumed one")
        self._free = 1 + int(knows_torsion) + int(knows_torsion and knows_growth)
        # The radius is fitted at the force of the twists; delta is its value at 1 N.
        self._at = float(np.log(f_n[twisted]).mean()) if knows_torsion else 0.0

    def solve(self) -> tuple[SoftContact, Float64, Float64]:
        """Return the contact, standard deviations of (ln mu, ln delta, gamma), and the remaining errors of ln f_n."""
        start = self._start
        free = self._free
        at = self._at
        first = np.array(
            [
                np.log(np.median(self._f_t / self._f_n)),
                np.log(start.delta) + start.gamma * at,
                start.gamma,
            ]
        )
        largest = np.log(PAD_HALF)
        bounds = (
            np.array([np.log(0.02), np.log(1e-4), 0.0])[:free],
            np.array([np.log(5.0), largest, 1.0])[:free],
        )
        x = np.clip(first[:free], *bounds)
        rough = least_squares(self._residuals, x, bounds=bounds, loss="cauchy", f_scale=SLIDE_STD)
        self._leave_out(np.abs(self._errors(rough.x)) > OUTLIER)
        fit = least_squares(
            self._residuals, rough.x, bounds=bounds, loss="soft_l1", f_scale=2.0 * SLIDE_STD
        )
        error = self._errors(fit.x)[self._agrees]
        scale = max(
            float(error @ error) / max(len(error) - free, 1), SLIDE_STD**2 if free > 2 else 0.0
        )
        covariance = np.zeros((3, 3))
        covariance[:free, :free] = np.linalg.pinv(fit.jac.T @ fit.jac) * scale
        radius_std = float(np.sqrt(covariance[1, 1]))
        if free > 1 and fit.x[1] > largest - 1e-3:
            self.notes.append(
                f"the twists give a contact larger than the pads: {1e3 * PAD_HALF:.0f} mm are assumed"
            )
        elif radius_std > VAGUE:
            self.notes.append(
                f"the contact's radius has an uncertainty of {radius_std:.0%}: twist more and pull less"
            )
        to_delta = np.array([0.0, 1.0, -at])
        std = np.sqrt(
            np.maximum([covariance[0, 0], to_delta @ covariance @ to_delta, covariance[2, 2]], 0.0)
        )
        return self._contact(fit.x), std, error

    def _leave_out(self, outliers: NDArray[np.bool_]) -> None:
        if 0 < outliers.sum() <= MOST_OUTLIERS * len(outliers):
            self.notes.append(
                f"{outliers.sum()} of {len(outliers)} slides do not agree with the others and are left out: repeat them"
            )
            self._agrees = ~outliers

    def _contact(self, x: Float64) -> SoftContact:
        start = self._start
        gamma = float(x[2]) if self._free > 2 else start.gamma
        delta = float(np.exp(x[1] - gamma * self._at)) if self._free > 1 else start.delta
        return SoftContact(float(np.exp(x[0])), delta, gamma, start.k, start.ellipsoid)

    def _errors(self, x: Float64) -> Float64:
        return np.log(
            np.maximum(least_force(self._f_t, self._tau_n, self._contact(x)), 1e-6) / self._f_n
        )

    def _residuals(self, x: Float64) -> Float64:
        prior = SLIDE_STD * (x[2:] - self._start.gamma) / GROWTH_STD
        return np.concatenate([self._errors(x)[self._agrees], prior])


def _slides(pushes: list[Push]) -> tuple[Float64, Float64, Float64]:
    """f_n, f_t and |tau_n| of each finger in each push while it slid, each of shape (slides,)."""
    found = []
    for push in pushes:
        if len(push.wrenches) < 2 * WINDOW:
            continue
        averaged = uniform_filter1d(np.asarray(push.wrenches, np.float64), WINDOW, axis=0)[
            WINDOW:-WINDOW
        ]
        forces, tangential, moments = pad_loads(averaged)
        for finger in range(2):
            f_n = forces[:, finger]
            f_t = tangential[:, finger]
            tau_n = np.abs(moments[:, finger])
            usable = f_n > LEAST_FORCE
            if usable.sum() < WINDOW:
                continue
            f_n = f_n[usable]
            f_t = f_t[usable]
            tau_n = tau_n[usable]
            load = np.hypot(f_t, tau_n / TYPICAL_RADIUS) / f_n
            most = load >= np.quantile(load, 1.0 - SLIDING_SHARE)
            found.append((f_n[most].mean(), f_t[most].mean(), tau_n[most].mean()))
    return tuple(np.array(found).reshape(-1, 3).T)  # type: ignore[return-value]


def pad_loads(wrenches: ArrayLike) -> tuple[Float64, Float64, Float64]:
    """Return the loads of both fingers without any filter.

    Args:
        wrenches: shape (2, 6) or (n, 2, 6), bias removed, as in `WrenchSample`.

    Returns:
        f_n [N], f_t [N] (magnitude) and tau_n [N·m] (the second finger's turned into the first pad's frame), each of
        shape (2,) or (n, 2).
    """
    w = np.asarray(wrenches, np.float64)
    flat = w.reshape(-1, 2, 6)
    rows = np.array(
        [[loads_of_finger(pair[0]), loads_of_finger(MIRROR * pair[1])] for pair in flat]
    )
    rows = rows.reshape(*w.shape[:-1], 4)
    return rows[..., 0], np.hypot(rows[..., 1], rows[..., 2]), rows[..., 3]


def _stiffness(squeeze: Push) -> tuple[float | None, float]:
    forces, _, _ = pad_loads(
        uniform_filter1d(np.asarray(squeeze.wrenches, np.float64), WINDOW, axis=0)
    )
    f_n = 2.0 * forces.min(axis=1)
    width = np.asarray(squeeze.width, np.float64)
    usable = (f_n > LEAST_FORCE) & np.isfinite(width)
    if usable.sum() < WINDOW or np.ptp(width[usable]) < 1e-5:
        return None, 0.0
    slope, offset = np.polyfit(width[usable], f_n[usable], 1)
    left = f_n[usable] - (slope * width[usable] + offset)
    return float(-slope), float(1.0 - left.var() / f_n[usable].var())


def write_calibration(calibration: GripCalibration, path: Path, fruit: str = "") -> None:
    """Write a calibration as YAML: first the cell's pads, then the quality of the values."""
    contact = calibration.contact
    assumed = ForceLoopSettings().stiffness
    stiffness = assumed if calibration.stiffness is None else calibration.stiffness
    uncertainty = min(2.0 * calibration.mu_std / contact.mu + calibration.residual, 0.5)
    twisted = (
        f"  delta: {1e3 * contact.delta:.4f} mm",
        f"  gamma: {contact.gamma:.4f}",
        "  measured: pomona calibrate grip",
    )
    lines = [
        f"# Pads on {fruit or 'a fruit'}; in the cell file: pads: {{include: {path.name}#pads}}",
        "pads:",
        "  driver: pads",
        *(twisted if calibration.delta_std else ()),
        f"  stiffness: {stiffness:.0f} N/m",
        "  friction:",
        f"    any: {contact.mu * (1.0 - uncertainty):.4f}..{contact.mu * (1.0 + uncertainty):.4f}",
        "quality:",
        f"  mu_std: {calibration.mu_std:.4f}",
        f"  delta_std_mm: {1e3 * calibration.delta_std:.4f}",
        f"  gamma_std: {calibration.gamma_std:.4f}",
        f"  relative_residual: {calibration.residual:.4f}",
        f"  slides: {calibration.pushes}",
        f"  stiffness_r2: {calibration.stiffness_r2:.4f}",
        f"  notes: [{', '.join(repr(note) for note in calibration.notes)}]",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
