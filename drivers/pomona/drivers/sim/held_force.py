"""Grip force on a hanging fruit relative to the minimum force that would have held it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(slots=True)
class HeldForce:
    """Normal forces of one grip, as the simulator has them."""

    # stamps, forces, least: while the fruit hung free: time [s], force summed over both fingers [N], and the least such
    # force with which the contact model holds the load of that moment [N]
    stamps: list[float] = field(default_factory=list)
    forces: list[float] = field(default_factory=list)
    least: list[float] = field(default_factory=list)
    # finger_peak, grasp_peak: largest force of one finger, and of both together, from the first touch on [N]
    finger_peak: float = 0.0
    grasp_peak: float = 0.0

    def note(self, now: float, force: float, least: float) -> None:
        """The fruit hangs free at this moment."""
        self.stamps.append(now)
        self.forces.append(force)
        self.least.append(least)

    def report(self) -> dict[str, float | None]:
        """Median force and median ratio to the least while it hung, both at the end, and one finger's peak."""
        stamps, forces, least = map(np.asarray, (self.stamps, self.forces, self.least))
        loaded = least > 0.2  # minimum grip force below which the ratio to it is not computed [N]
        figures: dict[str, float | None] = dict.fromkeys(
            ("hold_force_n", "hold_ratio", "end_force_n", "end_ratio"), None
        )
        if loaded.any():
            late = loaded & (stamps >= stamps[-1] - 0.1)  # length of the end of a grip [s]
            figures["hold_force_n"] = float(np.median(forces[loaded]))
            figures["hold_ratio"] = float(np.median(forces[loaded] / least[loaded]))
            if late.any():
                figures["end_force_n"] = float(np.mean(forces[late]))
                figures["end_ratio"] = float(np.mean(forces[late]) / np.mean(least[late]))
        return {**figures, "finger_peak_n": self.finger_peak, "grasp_peak_n": self.grasp_peak}
