"""Reference of the grip force: a ramp to the initial force, then static plus dynamic term.

f_ref = margin * f_ns + f_nd (the paper's eq. slip_avoidance_control_law), through a 50 Hz low-pass. The static part
rises with the load and falls slowly. Two more parts act for moments only, like the dynamic one: the rise of the load,
which continues until the fingers answer, and the lack of force near the limit surface, where a sliding fruit shows no
more than its friction. `ReferenceMode` names the law that applies; reference_modes.py has one class for each.
"""

from __future__ import annotations

import math

from pomona.skills.grip.estimate_kernel import GripEstimate
from pomona.skills.grip.reference_modes import (
    CarriedMode,
    CatchingMode,
    Levels,
    LiftingMode,
    Mode,
    PivotingMode,
    ReferenceMode,
    SlidingMode,
    StandingMode,
)
from pomona.skills.grip.settings import GripSettings

REQUESTED = (ReferenceMode.PIVOTING, ReferenceMode.SLIDING)  # modes that a skill starts and ends
HANGING = (ReferenceMode.CARRIED, ReferenceMode.CATCHING)  # modes of a fruit that hangs in the fingers


class ForceReference:
    """Grip force to track, and the mode that chooses it.

    Attributes:
        f_ref: the reference [N].
        frozen: reason why the reference may not fall any more; empty while it may.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.f_ref = 0.0
        self.mode = ReferenceMode.RAMP
        self.frozen = ""
        self._levels = levels = Levels(settings)
        self._standing, self._sliding = StandingMode(levels), SlidingMode(levels)
        carried = CarriedMode(levels)
        laws = (LiftingMode(levels), carried, CatchingMode(levels, carried), PivotingMode(levels))
        self._modes: dict[ReferenceMode, Mode] = {law.mode: law for law in (self._standing, self._sliding, *laws)}
        self._resumed = ReferenceMode.LIFTING

    @property
    def wanted(self) -> float:
        """Force that the load needs by the law of the mode [N]."""
        return self._levels.wanted

    @property
    def for_weight(self) -> float:
        """Force that the load would need without its moment, as gripped at its centre [N]."""
        return self._levels.for_weight

    @property
    def is_carried(self) -> bool:
        """True for a fruit that hangs in the fingers."""
        return (self._resumed if self.mode in REQUESTED else self.mode) in HANGING

    @property
    def has_settled(self) -> bool:
        """True when the lasting part has come down to the wanted force."""
        return self._levels.has_settled()

    def set_friction(self, settings: GripSettings) -> None:
        """Take settings with another friction."""
        self._levels.set_friction(settings)

    def begin(self, f_n: float) -> None:
        """Start from the force at contact [N]."""
        self.f_ref = self._levels.held = min(max(f_n, 0.0), self._levels.settings.initial_force)

    def ramp(self, elapsed: float) -> float:
        """Rise towards the initial force, and return the reference [N]."""
        self.f_ref = self._levels.raise_to_initial(elapsed)
        return self.f_ref

    def stand(self, load: tuple[float, float]) -> None:
        """Hold a fruit that stands under a tangential load [N]."""
        self.mode = ReferenceMode.STANDING
        self._standing.start(load)

    def slide(self, force: float | None) -> None:
        """Keep this grip force [N] under any load, or resume the mode before."""
        if force is not None:
            self._sliding.force = force
        self._request(ReferenceMode.SLIDING, force is not None)

    def pivot(self, on: bool) -> None:
        """Bear only the weight, so that the fruit turns, or resume the mode before."""
        self._request(ReferenceMode.PIVOTING, on)

    def _request(self, mode: ReferenceMode, on: bool) -> None:
        if on and self.mode not in REQUESTED:
            self._resumed = self.mode
        self.mode = mode if on else self._resumed if self.mode is mode else self.mode

    def freeze(self, reason: str) -> None:
        """Never lower the reference again; the first reason is kept."""
        self.frozen = self.frozen or reason
        self._levels.may_fall = False

    def distrust(self, reason: str) -> None:
        """Freeze, and rise no further than to a multiple of the force until now."""
        levels = self._levels
        if not math.isfinite(levels.limit):
            levels.limit = levels.tuned.fault_ratio * max(self.f_ref, levels.settings.floor)
        self.freeze(reason)

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> None:
        """Follow the law of the mode for `elapsed` seconds.

        Args:
            estimate: after the newest sample.
            force_coming: sum of both fingers' forces once the commanded motion has taken effect [N].
            elapsed: time since the last call [s].
        """
        self.mode = self._modes[self.mode].next_mode(estimate)
        law = self._modes[self.mode]
        f_ref = law.follow(estimate, force_coming, elapsed)
        self.mode = law.next_mode(estimate)
        self.f_ref = min(f_ref, self._levels.limit, self._levels.settings.loop.max_force)
