"""The wall's score of a run, for reports only: the fate of every fruit, and the loads on the branches."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.bruises import impact_force, peak_pressure
from pomona.applications.harvest.model import WallModel
from pomona.applications.harvest.stems import AT_SPUR, HANGS, TORN, Stems
from pomona.applications.harvest.touches import BY_HARD, BY_LINING, BY_PAD, Touches
from pomona.applications.harvest.wood import bending_stress
from pomona.executive import Float64
from pomona.tools.simulation import TIMESTEP, container_of

TOUCH = 0.05  # a pad holds a fruit when it is pressed by more than this [N]
RECENT = 1.0  # a fruit that comes off so soon after the robot touched it or its branch was knocked off [s]
STEADY = 0.05  # time over which a pressing force is averaged before it counts as static [s]; impacts do not
GRIPPED = (
    0.05  # a break can unload a pad: both held the fruit if they touched it within this time [s]
)
HIT = 0.5  # force above which the robot strikes wood, a wire or a fixed object [N]


@dataclass(slots=True)
class FruitStory:
    """The fate of one fruit."""

    looked: Float64  # T_base_fruit at the last exposure of a camera
    came_off: float | None = (
        None  # when its stem broke [s], and how: "gripped", "knocked" or "fell"
    )
    how: str = ""
    stem_force: float = 0.0  # largest force of its stem up to the break [N]
    pressure: float = 0.0  # largest static pressure on its skin [Pa]
    impact: float = 0.0  # largest force of an impact [N]


@dataclass(slots=True)
class WallScore:
    """Watches every step. Reads the simulator's truth and changes nothing."""

    built: WallModel
    data: Any
    stems: Stems
    fruits: list[FruitStory] = field(init=False)
    touches: Touches = field(init=False)
    strikes: dict[str, int] = field(default_factory=dict)
    wood_force: float = 0.0
    wood_stress: float = 0.0
    _touched: Float64 = field(init=False)
    _lateral_touched: Float64 = field(init=False)
    _lateral_of: NDArray[np.int64] = field(init=False)
    _steady: Float64 = field(init=False)
    _gripped: Float64 = field(init=False)
    _striking: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.built.fruit_bodies)
        self.fruits = [FruitStory(self._pose(i)) for i in range(count)]
        self.touches = Touches(self.built, self.data)
        self._touched, self._lateral_touched = (
            np.full(count, -np.inf),
            np.full(len(self.built.wall.laterals), -np.inf),
        )
        self._lateral_of = np.array(
            [self.built.wall.spurs[each.spur].lateral for each in self.built.wall.fruits], int
        )
        self._steady, self._gripped = np.zeros((count, 3)), np.full(count, -np.inf)

    def look(self, broken: int) -> None:
        """After a step, in which a stem broke, or none (-1)."""
        now, touches = float(self.data.time), self.touches
        touches.look()
        self._touched[touches.by_robot] = now
        self._lateral_touched[touches.laterals] = now
        self._lateral_touched[self._lateral_of[touches.by_robot]] = (
            now  # a pulled fruit shakes its neighbours
        )
        self._gripped[(touches.pads > TOUCH).all(axis=1)] = now
        self._note_presses()
        self.wood_force = max(self.wood_force, touches.wood)
        for name, force in (
            ("wood", touches.wood),
            ("wire", touches.wire),
            ("fixed", touches.fixed),
        ):
            striking = force > HIT
            if striking and not self._striking.get(name, False):
                self.strikes[name] = self.strikes.get(name, 0) + 1
            self._striking[name] = striking
        if broken >= 0:
            story = self.fruits[broken]
            recent = (
                max(self._touched[broken], self._lateral_touched[self._lateral_of[broken]])
                > now - RECENT
            )
            gripped = bool(self._gripped[broken] > now - GRIPPED)
            story.came_off, story.how = (
                now,
                "gripped" if gripped else "knocked" if recent else "fell",
            )
            story.stem_force = float(self.stems.peak[broken])

    def look_at_wood(self) -> None:
        """The largest bending stress of a lateral, a hundred times a second."""
        numbers = self.built.wall.numbers
        for lateral, dofs in zip(self.built.wall.laterals, self.built.lateral_dofs, strict=True):
            moments = np.hypot(*np.abs(self.data.qfrc_passive[dofs].reshape(-1, 2).T))
            base, tip = lateral.diameters
            across = base + (tip - base) * (np.arange(len(moments)) + 0.5) / len(moments)
            stress = max(
                bending_stress(float(m), float(d)) for m, d in zip(moments, across, strict=True)
            )
            self.wood_stress = max(self.wood_stress, stress / numbers.wood_rupture)

    def note_look(self) -> None:
        """A camera looks now."""
        for i, story in enumerate(self.fruits):
            if self.stems.state[i] == HANGS:
                story.looked = self._pose(i)

    def _note_presses(self) -> None:
        """Record the static pressure of lasting forces and the impact of touches that begin."""
        numbers, forces = self.built.wall.numbers, self.touches.forces
        self._steady += (forces - self._steady) * (TIMESTEP / STEADY)
        moduli = np.array([numbers.modulus_pad, numbers.modulus_lining, numbers.modulus_hard])
        for i in np.flatnonzero((forces > 0.0).any(axis=1)):
            fruit, story = self.built.wall.fruits[i], self.fruits[i]
            for k in (BY_PAD, BY_LINING, BY_HARD):
                press = peak_pressure(float(self._steady[i, k]), fruit.radius, float(moduli[k]))
                impulse = fruit.mass * float(self.touches.speeds[i, k])
                story.pressure = max(story.pressure, press)
                story.impact = max(
                    story.impact, impact_force(impulse, fruit.mass, fruit.radius, float(moduli[k]))
                )

    # ------------------------------------------------------------------------------------------ reporting

    def bruised(self, i: int) -> bool:
        """Return True if a fruit's skin is damaged."""
        numbers, story = self.built.wall.numbers, self.fruits[i]
        return story.pressure > numbers.bruise_pressure or story.impact > numbers.bruise_impact

    def place(self, i: int) -> str:
        """Where a fruit is: "hangs", "hand", "ground", "lies", or the name of a crate."""
        if self.stems.state[i] == HANGS:
            return "hangs"
        held = self.touches.pads[i] > TOUCH
        if held.all():
            return "hand"
        crate = container_of(
            self.built.fixed, self._pose(i)[:3, 3], self.built.wall.fruits[i].radius
        )
        if crate and not held.any():
            return crate
        return "ground" if self.touches.grounded[i] else "lies"

    def report(self, reachable: tuple[bool, ...] | None = None) -> dict[str, object]:
        """Return the score as plain values."""
        stories, states = self.fruits, self.stems.state
        places = [self.place(i) for i in range(len(stories))]
        picked = [p not in ("hangs", "hand", "ground", "lies") for p in places]
        taken = [i for i, story in enumerate(stories) if story.how == "gripped"]
        forces = [stories[i].stem_force for i in taken]
        bruised, gripped = (
            [self.bruised(i) for i in range(len(stories))],
            np.isfinite(self._gripped),
        )
        return {
            "apples": len(stories),
            "reachable": sum(reachable) if reachable is not None else None,
            "gripped": int(gripped.sum()),
            "detached": len(taken),
            "picked": sum(picked),
            "all_picked": all(picked),
            "dropped": sum(places[i] in ("ground", "lies") for i in taken),
            "knocked_off": sum(story.how == "knocked" for story in stories),
            "fell": sum(story.how == "fell" for story in stories),
            "bruised": sum(bruised),
            "stems_torn": int((states == TORN).sum()),
            "stem_force_median_n": float(np.median(forces)) if forces else None,
            "stem_force_p95_n": float(np.percentile(forces, 95)) if forces else None,
            "wood_force_n": self.wood_force,
            "wood_stress_ratio": self.wood_stress,
            "collisions": sum(self.strikes.values()),
            "collided_with": sorted(self.strikes),
            "numbers": self.built.wall.numbers.digest(),
            "which_gone": self._which(place != "hangs" for place in places),
            "which_reachable": self._which(reachable or ()),
            "which_gripped": self._which(gripped),
            "which_bruised": self._which(bruised),
            "fruits": [self._fruit(i, places[i], reachable) for i in range(len(stories))],
        }

    def _which(self, marks: Iterable[object]) -> str:
        """Return the numbers of the marked fruit in the form of the option `without`."""
        return (
            ",".join(
                str(f.number)
                for f, mark in zip(self.built.wall.fruits, marks, strict=False)
                if mark
            )
            or "none"
        )

    def _fruit(self, i: int, place: str, reachable: tuple[bool, ...] | None) -> dict[str, object]:
        fruit, story = self.built.wall.fruits[i], self.fruits[i]
        return {
            "name": f"fruit_{fruit.number}",
            "place": place,
            "cluster": fruit.cluster,
            "reachable": None if reachable is None else reachable[i],
            "how": story.how,
            "stem_kept": bool(self.stems.state[i] == AT_SPUR)
            if self.stems.state[i] != HANGS
            else None,
            "stem_force_n": story.stem_force,
            "pressure_mpa": 1e-6 * story.pressure,
            "impact_n": story.impact,
            "bruised": self.bruised(i),
            "dimensions_m": [float(d) for d in fruit.dimensions],
            "T_base_fruit": self._pose(i).tolist(),
            "T_base_fruit_at_look": story.looked.tolist(),
        }

    def _pose(self, i: int) -> Float64:
        body, T = self.built.fruit_bodies[i], np.eye(4)
        T[:3, :3], T[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return T
