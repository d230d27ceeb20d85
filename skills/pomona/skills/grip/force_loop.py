"""Force loop: the speed of the fingers that brings the measured grasp force to its reference.

    v = -(c (φ⁻¹(f_ref) - φ⁻¹(f)) + d/dt φ⁻¹(f_ref)),   φ⁻¹(f) = f / s1   or   sqrt(f / s2)

φ⁻¹(f) is the deformation of the pads under the grip force f. The position of the fingers integrates the speed, so a
constant reference is reached without droop. The rate of the reference is fed forward, so a rising one is tracked
without lag; the gain then acts on the error before the rise, which would else be corrected twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class PadStiffness:
    """Rise of the grip force (both fingers) as the opening closes on the fruit."""

    linear: float = 2000.0  # s1 [N/m], of the opening: two pads in series
    quadratic: float = 0.0  # s2 [N/m²] for pads that stiffen, f = s2 x²; 0 for linear ones

    def pressed(self, f_n: float) -> float:
        """Return φ⁻¹, the closing of the opening under a grip force [m]."""
        return math.sqrt(max(f_n, 0.0) / self.quadratic) if self.quadratic else f_n / self.linear

    def slope(self, f_n: float) -> float:
        """Return the grip force per metre of closing, at a grip force [N/m]."""
        return 2.0 * math.sqrt(self.quadratic * max(f_n, 0.1)) if self.quadratic else self.linear


@dataclass(frozen=True, slots=True)
class ForceLoopSettings:
    """Gain and limits of the force loop."""

    gain: float = 20.0  # c [1/s]
    lag: float = 0.015  # of fingers and measurement: delay of a commanded motion in the measured force [s]
    stiffness: PadStiffness = field(default_factory=PadStiffness)  # of the pads
    max_force: float = 14.0  # largest grip force [N]; each finger presses with at most half of it
    closing_speed: float = 0.2  # closing_speed, opening_speed: bounds of the opening's rate, both positive [m/s]
    opening_speed: float = 0.012
    command_period: float = 0.02  # time between two rates [s]; the WSG's finger script reaches 50 Hz


def finger_speed(
    f_ref: float,
    f_ref_rate: float,
    f_n: float,
    settings: ForceLoopSettings,
    speed_before: float = 0.0,
    error_feedthrough: float = 1.0,
    hardest: float = 0.0,
) -> float:
    """Return the rate of the opening to command [m/s]; negative closes.

    The rate keeps the force within the limit until the next command. It is 0.0 for input that is not finite, and where
    a force of more than twice the limit would be raised further.

    Args:
        f_ref, f_ref_rate: reference of the grip force [N] and its rate [N/s].
        f_n: measured grip force [N].
        settings: gain and limits.
        speed_before: last commanded rate [m/s].
        error_feedthrough: 0 … 1; with 1 the gain acts on the whole error although its rise is fed forward, which
            overshoots.
        hardest: twice the stronger finger's force [N]: it stays within the limit, too.
    """
    if not all(map(math.isfinite, (f_ref, f_ref_rate, f_n, hardest))):
        return 0.0
    f_n = abs(f_n)
    if f_n > 2.0 * settings.max_force and f_ref > f_n:
        return 0.0
    if f_n > settings.max_force or f_ref > settings.max_force:
        f_ref, f_ref_rate = min(f_ref, settings.max_force), min(f_ref_rate, 0.0)
    pads = settings.stiffness
    # The rise of the reference is fed forward: the gain acts on the error before it.
    before = f_ref - (1.0 - error_feedthrough) * f_ref_rate * settings.command_period
    error = pads.pressed(before) - pads.pressed(f_n) + speed_before * settings.lag
    closing = settings.gain * error + f_ref_rate / pads.slope(f_n)
    most = max(f_n, hardest)
    left = (settings.max_force - most) / pads.slope(most) + speed_before * settings.lag
    fastest = min(settings.closing_speed, max(left, 0.0) / settings.command_period)
    return min(max(-closing, -fastest), settings.opening_speed)
