"""The belt's score of a run, for reports only: the fate of every fruit, and the hand's contacts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pomona.applications.conveyor.belt_model import BeltModel
from pomona.executive import Float64
from pomona.tools.simulation import PADS, Press, Presses, container_of, press_figures

LIFTED = 0.08  # height over its place on the belt from which a fruit between the pads counts as lifted [m]
TOUCH = 0.05  # a pad touches a fruit that it presses by more than this [N]


@dataclass(slots=True)
class FruitFate:
    """One run of a fruit over the belt.

    Attributes:
        number: of the body; kind: its name in the cell file; at: when it was put on the belt [s].
        lifted, slip: whether it was lifted, and how far the held point moved along the pads meanwhile [m].
        peak: largest force of one pad [N].
        press: its largest.
        touches: contacts with the robot, each counted at its begin.
        ending: passed, in a crate's name, fell; empty while it is under way.
    """

    number: int
    kind: str
    at: float
    lifted: bool = False
    slip: float = 0.0
    peak: float = 0.0
    press: Press = (0.0, "")
    touches: int = 0
    ending: str = ""
    touching: bool = False
    held_at: tuple[Float64, Float64] | None = None


@dataclass(slots=True)
class BeltScore:
    """Watches the state at 100 Hz. Reads the simulator's truth and changes nothing.

    Attributes:
        fates: of all fruit, in the order in which they came.
        belt_hits, self_hits: contacts of the robot with the belt and with itself, each counted at its begin.
    """

    built: BeltModel
    state: Any
    fates: list[FruitFate] = field(default_factory=list)
    belt_hits: int = 0
    self_hits: int = 0
    _now: dict[int, FruitFate] = field(default_factory=dict)
    _presses: Presses = field(init=False)
    _touching: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._presses = Presses(self.built, self.state)

    def begin(self, number: int, at: float) -> None:
        """A fruit is put on the belt."""
        self._presses.largest[number] = 0.0, ""
        fate = FruitFate(number, self.built.fruits[number].name, at)
        self.fates.append(fate)
        self._now[number] = fate

    def end(self, number: int, ending: str) -> None:
        """It has left."""
        self._now.pop(number).ending = ending

    def held(self, number: int) -> bool:
        """Return True while a pad touches a fruit."""
        return max(self._pressed(number)) > TOUCH

    def crate_of(self, number: int) -> str:
        """Return the name of the crate that a fruit lies in, or nothing."""
        radius = float(self.built.fruits[number].dimensions.max()) / 2.0
        return container_of(self.built.fixed, self.state.body(f"fruit_{number}").xpos, radius)

    def watch(self) -> None:
        """Look at the contacts of this moment."""
        self.belt_hits += self._begins("robot_belt")
        self.self_hits += self._begins("robot_robot")
        self._presses.watch()
        for number, fate in self._now.items():
            fate.press = self._presses.largest[number]
            touching = bool(self._view(f"robot_fruit_{number}")[0] > 0.0)
            fate.touches += touching and not fate.touching
            fate.touching = touching
            if touching:
                self._watch_grip(number, fate)

    def report(self) -> dict[str, object]:
        """Return the score as plain values."""
        ended = [fate for fate in self.fates if fate.ending]
        lifted = [fate for fate in self.fates if fate.lifted]
        under_way = {
            number for number in self._now if not self.held(number) and self.crate_of(number)
        }
        crates = [f for f in ended if f.ending not in ("passed", "fell")] + [
            self._now[n] for n in under_way
        ]
        hurt = [fate for fate in self.fates if fate.touches and not fate.lifted]
        return {
            "offered": len(self.fates),
            "lifted": len(lifted),
            "put_away": len(crates),
            "passed": sum(fate.ending == "passed" for fate in ended),
            "drops": sum(fate.ending in ("passed", "fell") for fate in lifted),
            "touched_only": len(hurt),
            "collisions": self.belt_hits + self.self_hits,
            "slip_mm": 1e3 * max((fate.slip for fate in lifted), default=0.0),
            "finger_peak_n": max((fate.peak for fate in lifted), default=0.0),
            **press_figures([fate.press for fate in self.fates]),
            "fates": [
                {
                    "kind": f.kind,
                    "lifted": f.lifted,
                    "ending": f.ending,
                    "slip_mm": 1e3 * f.slip,
                    "touches": f.touches,
                }
                for f in self.fates
            ],
        }

    def _watch_grip(self, number: int, fate: FruitFate) -> None:
        pressed = self._pressed(number)
        fate.peak = max(fate.peak, *pressed)
        body = self.state.body(f"fruit_{number}")
        tool = self.state.body("tool0")
        R_tool = tool.xmat.reshape(3, 3)
        R_fruit = body.xmat.reshape(3, 3)
        if min(pressed) < TOUCH or self._view(f"belt_{number}")[0] > 0.0:
            fate.held_at = None if min(pressed) < TOUCH else fate.held_at
            return
        p = R_tool.T @ (body.xpos - tool.xpos)
        R = R_tool.T @ R_fruit
        if fate.held_at is None:  # the fruit's point between the pads, and where it is in the tool
            between = np.asarray(self.built.model.site("tcp").pos)
            fate.held_at = between.copy(), R.T @ (between - p)
        before, point = fate.held_at
        now = R @ point + p
        fate.slip = max(fate.slip, float(np.hypot(now[0] - before[0], now[2] - before[2])))
        half = float(self.built.fruits[number].dimensions.min()) / 2.0
        fate.lifted = fate.lifted or bool(body.xpos[2] > self.built.belt.top + half + LIFTED)

    def _pressed(self, number: int) -> list[float]:
        """Forces of the pads on a fruit [N]."""
        return [float(np.linalg.norm(self._view(f"{pad}_fruit_{number}")[1:4])) for pad in PADS]

    def _begins(self, name: str) -> bool:
        touching = bool(self._view(name)[0] > 0.0)
        begins = touching and not self._touching.get(name, False)
        self._touching[name] = touching
        return begins

    def _view(self, name: str) -> Float64:
        sensor = self.built.model.sensor(name)
        view: Float64 = self.state.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
        return view
