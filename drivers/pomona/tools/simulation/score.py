"""The world's score of a run, for reports only: lift, slip and forces of the fruit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.bruises import Presses, press_figures
from pomona.tools.simulation.layout import PADS
from pomona.tools.simulation.scene import SimScene, container_of, fixed_names

LIFTED = 0.03  # a fruit counts as lifted this far above where it stood [m]
CLEAR = 1e-3  # an unsupported fruit hangs above this height [m]: pads that rub make it hop by less
TOUCH = 0.05  # a pad holds a fruit when it is pressed by more than this [N]
SLID_OUT = 10e-3
"""Slip at the end of a grip beyond which the fruit is lost [m]; opening pads cause far less. It is also the distance
from the gripped position at which the pads have released a fruit: a jolt interrupts stiff contacts for some
milliseconds repeatedly without that.
"""

LOOK = 0.01  # time between two looks [s]


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
        """Median force, median and least ratio to the least force while it hung, both at the end, one finger's peak."""
        stamps, forces, least = map(np.asarray, (self.stamps, self.forces, self.least))
        loaded = least > 0.2  # minimum grip force below which the ratio to it is not computed [N]
        figures: dict[str, float | None] = dict.fromkeys(
            ("hold_force_n", "hold_ratio", "least_ratio", "end_force_n", "end_ratio"), None
        )
        if loaded.any():
            late = loaded & (stamps >= stamps[-1] - 0.1)  # length of the end of a grip [s]
            figures["hold_force_n"] = float(np.median(forces[loaded]))
            ratios = forces[loaded] / least[loaded]
            figures["hold_ratio"] = float(np.median(ratios))
            figures["least_ratio"] = float(ratios.min())
            if late.any():
                figures["end_force_n"] = float(np.mean(forces[late]))
                figures["end_ratio"] = float(np.mean(forces[late]) / np.mean(least[late]))
        return {**figures, "finger_peak_n": self.finger_peak, "grasp_peak_n": self.grasp_peak}


@dataclass(slots=True)
class Grip:
    """One fruit between the pads, from the first touch of both to the loss of one."""

    T_tool_fruit: Float64  # pose when the tool last began to move before the fruit hung; slip is measured against it
    point: Float64  # the fruit's material point between the pads at that time, in its own frame [m]
    slip: float = 0.0  # largest motion of that point along the pads [m]
    turn: float = 0.0  # largest rotation against the tool [rad]
    peak: float = 0.0  # largest force, summed over both fingers [N]
    least: float = 0.0  # largest minimum grip force of the contact model for the load while the fruit hung free [N]
    hung: bool = False  # whether the fruit was clear of its support
    held: HeldForce = field(default_factory=HeldForce)  # the fingers' normal forces, over time
    lost: bool = False  # the fruit slid out of it, or fell


@dataclass(slots=True)
class FruitRecord:
    """Events of one fruit; bumps are touches by the robot while it held another one.

    `ending`: position of the fruit in the tool when the last grip lost contact, which may return; `fell`: it hung then,
    and had no support.
    """

    rest: Float64
    looked: Float64
    grip: Grip | None = None
    last_grip: Grip | None = None
    lost_at: float = -1.0
    ending: Float64 | None = None
    fell: bool = False
    drops: int = 0
    lost: int = 0
    touches: int = 0
    bumps: int = 0
    touching: bool = False

    def end_grip(self) -> None:
        """The last grip is over: count a drop, or a fruit that slid out."""
        grip = self.last_grip
        assert grip is not None
        self.drops += self.fell
        if not grip.lost and (self.fell or grip.slip > SLID_OUT):
            grip.lost = True
            self.lost += 1
        self.ending = None


@dataclass(slots=True)
class Scorer:
    """Watches the state at 100 Hz. Reads the simulator's truth and changes nothing."""

    scene: SimScene
    state: Any
    _fruits: list[FruitRecord] = field(init=False)
    _robot: list[Float64] = field(init=False)
    _carriers: tuple[str, ...] = field(init=False)
    _hits: dict[str, int] = field(init=False, default_factory=dict)
    _touching: dict[str, bool] = field(init=False, default_factory=dict)
    _forbidden: dict[str, Float64] = field(init=False)
    _wrenches: list[Float64] = field(init=False)
    _source: list[str] = field(init=False)  # crate in which each fruit was at the start
    _presses: Presses = field(init=False)

    def __post_init__(self) -> None:
        self._carriers = ("table", *fixed_names(self.scene.fixed))
        self._source = [self._inside(i) for i in range(len(self.scene.fruits))]
        self._presses = Presses(self.scene, self.state)
        count = len(self.scene.fruits)
        self._fruits = [FruitRecord(self._pose(i), self._pose(i)) for i in range(count)]
        self._robot = [self._view(f"robot_fruit_{i}") for i in range(count)]
        names = [self.scene.model.sensor(i).name for i in range(self.scene.model.nsensor)]
        watched = [n for n in names if n.startswith("robot_") and not n.startswith("robot_fruit")]
        self._forbidden = {
            n.removeprefix("robot_").removeprefix("fixed_"): self._view(n) for n in watched
        }
        self._wrenches = [self._view(f"wrench_{pad}") for pad in PADS]

    # ------------------------------------------------------------------------------------------- watching

    def watch(self) -> None:
        """Look at the contacts of this moment."""
        for name, sensor in self._forbidden.items():
            touching = sensor[0] > 0.0
            if touching and not self._touching.get(name, False):
                self._hits[name] = self._hits.get(name, 0) + 1
            self._touching[name] = touching
        self._presses.watch()
        for i, record in enumerate(self._fruits):
            touching = bool(self._robot[i][0] > 0.0)
            begins = touching and not record.touching
            record.touches += begins
            record.bumps += begins and any(
                other.grip is not None for other in self._fruits if other is not record
            )
            record.touching = touching
            if touching or record.grip is not None or record.ending is not None:
                self._watch_grip(i, record)

    def note_look(self) -> None:
        """Note an exposure, perhaps many times a second; a fruit in the hand or in a crate is not measured later."""
        for i, record in enumerate(self._fruits):
            if record.grip is None and not self._put_away(i):
                record.looked = self._pose(i)

    def _watch_grip(self, i: int, record: FruitRecord) -> None:
        pads = [self._presses.force(i, pad) for pad in PADS]
        forces = [float(np.linalg.norm(pad)) for pad in pads]
        is_carried = any(self._presses.force(i, name).any() for name in self._carriers)
        held = min(forces) > TOUCH
        if not held:
            if record.grip is not None:
                record.last_grip = record.grip
                record.grip = None
                record.lost_at = float(self.state.time)
                record.ending = self._in_tool(i)
                record.fell = bool(record.last_grip.hung and not is_carried)
            elif record.ending is not None and (
                (record.fell and is_carried)
                or float(np.linalg.norm(self._in_tool(i) - record.ending)) > SLID_OUT
            ):
                record.end_grip()
            return
        record.ending = None
        T_base_tool = self._tool()
        T_base_fruit = self._pose(i)
        supported = is_carried or T_base_fruit[2, 3] - record.rest[2, 3] < CLEAR
        if record.grip is None:
            # a fruit that both pads touch again within this time is still in the same grip [s]
            again = record.last_grip is not None and self.state.time - record.lost_at < 0.5
            record.grip = record.last_grip if again else self._take_hold(T_base_tool, T_base_fruit)
        grip = record.grip
        assert grip is not None
        grip.peak = max(grip.peak, sum(forces))
        normal = self._normal_forces(pads)
        grip.held.finger_peak = max(grip.held.finger_peak, *normal)
        grip.held.grasp_peak = max(grip.held.grasp_peak, sum(normal))
        if (
            supported and not grip.hung and self._tool_speed() < 3e-3
        ):  # the tool is at rest below this speed [m/s]
            fresh = self._take_hold(T_base_tool, T_base_fruit)
            grip.T_tool_fruit = fresh.T_tool_fruit
            grip.point = fresh.point
            grip.slip = grip.turn = (
                0.0  # pads that slide over a fruit that stands are no slip of a held one
            )
            return
        self._measure_slip(grip, np.linalg.inv(T_base_tool) @ T_base_fruit)
        if not supported:
            grip.hung = True
            least = self._least_force()
            grip.least = max(grip.least, least)
            grip.held.note(float(self.state.time), sum(normal), least)

    def _in_tool(self, fruit: int) -> Float64:
        """Where a fruit's centre is in the tool's frame, shape (3,) [m]."""
        T_tool_fruit: Float64 = np.linalg.inv(self._tool()) @ self._pose(fruit)
        return T_tool_fruit[:3, 3]

    def _take_hold(self, T_base_tool: Float64, T_base_fruit: Float64) -> Grip:
        T_tool_fruit = np.linalg.inv(T_base_tool) @ T_base_fruit
        tcp = self.scene.model.site("tcp").pos
        return Grip(T_tool_fruit, T_tool_fruit[:3, :3].T @ (tcp - T_tool_fruit[:3, 3]))

    def _measure_slip(self, grip: Grip, T_tool_fruit: Float64) -> None:
        """Motion of the held point in the pads' plane (x and z of the tool); across it the soft pads only give."""
        before = grip.T_tool_fruit[:3, :3] @ grip.point + grip.T_tool_fruit[:3, 3]
        now = T_tool_fruit[:3, :3] @ grip.point + T_tool_fruit[:3, 3]
        grip.slip = max(grip.slip, float(np.hypot(now[0] - before[0], now[2] - before[2])))
        cosine = (np.trace(T_tool_fruit[:3, :3].T @ grip.T_tool_fruit[:3, :3]) - 1.0) / 2.0
        grip.turn = max(grip.turn, float(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def _normal_forces(self, pads: Sequence[Float64]) -> tuple[float, ...]:
        """Of each pad on this fruit, across its face [N]."""
        faces = [self.state.site(pad).xmat.reshape(3, 3)[:, 2] for pad in PADS]
        return tuple(abs(float(face @ pad)) for face, pad in zip(faces, pads, strict=True))

    def _least_force(self) -> float:
        """Return the force of both fingers at which the contact model's ellipsoidal limit surface just holds the load
        [N]. The load is the force of both pads along their faces, and the torque about the closing axis.
        """
        shear = np.zeros(3)
        twist = 0.0
        for pad, wrench, side in zip(PADS, self._wrenches, (1.0, -1.0), strict=True):
            normal = self.state.site(pad).xmat.reshape(3, 3)[:, 2]
            force = wrench[:3]
            shear += force - normal * (normal @ force)
            twist += side * float(normal @ wrench[3:6])
        pads = self.scene.pads
        return float(np.hypot(np.linalg.norm(shear) / pads.friction, twist / pads.torsion))

    # ------------------------------------------------------------------------------------------ reporting

    def report(self) -> dict[str, object]:
        """Return the score as plain values; of the fruit that was lifted or gripped last, else of the target."""
        index = self._judged()
        fruit = self.scene.fruits[index]
        record = self._fruits[index]
        pose = self._pose(index)
        grip = record.grip or record.last_grip
        risen = float(pose[2, 3] - record.rest[2, 3])
        hits = dict(self._hits)
        for i, other in enumerate(self._fruits):
            never_gripped = other.grip is None and other.last_grip is None and i != index
            if wrong := other.touches if never_gripped else other.bumps:
                hits[self.scene.fruits[i].name] = wrong
        return {
            "lifted": bool(risen > LIFTED and record.grip is not None)
            if grip and not self._put_away(index)
            else None,
            "fruit": fruit.name,
            "place": str(fruit.place),
            "target": self.scene.fruits[0].name,
            "height_gained_m": risen,
            "slip_mm": 1e3 * grip.slip if grip else None,
            "rotation_deg": float(np.degrees(grip.turn)) if grip else None,
            "peak_force_n": grip.peak if grip else None,
            "least_force_n": grip.least if grip and grip.hung else None,
            **(grip.held if grip else HeldForce()).report(),
            "drops": sum(each.drops for each in self._fruits),
            "lost": sum(each.lost for each in self._fruits),
            **press_figures(self._presses.largest),
            "collisions": sum(hits.values()),
            "collided_with": sorted(hits),
            "dimensions_m": [float(d) for d in fruit.dimensions],
            "mass_kg": fruit.mass,
            "friction": self.scene.pads.friction,
            "T_base_fruit": pose.tolist(),
            "T_base_fruit_at_look": record.looked.tolist(),
            "fruits": [
                {
                    "name": each.name,
                    "place": each.place,
                    "dimensions_m": [float(d) for d in each.dimensions],
                    "T_base_fruit": self._pose(i).tolist(),
                    "T_base_fruit_at_look": self._fruits[i].looked.tolist(),
                    "inside": self._inside(i),
                }
                for i, each in enumerate(self.scene.fruits)
            ],
            "put_away": sum(self._put_away(i) for i in range(len(self._fruits))),
        }

    def _judged(self) -> int:
        for i, record in enumerate(self._fruits):
            if record.grip is not None:
                return i
        gripped = [i for i, record in enumerate(self._fruits) if record.last_grip is not None]
        return max(gripped, key=lambda i: self._fruits[i].lost_at, default=0)

    def _inside(self, i: int) -> str:
        """Return the name of the crate that a fruit lies in."""
        return container_of(
            self.scene.fixed,
            self._pose(i)[:3, 3],
            float(self.scene.fruits[i].dimensions.max()) / 2.0,
        )

    def _put_away(self, i: int) -> bool:
        """Return True if a fruit lies in another crate than at the start."""
        return self._inside(i) not in ("", self._source[i])

    def _pose(self, i: int) -> Float64:
        body = self.state.body(f"fruit_{i}")
        return _pose(body.xpos, body.xmat)

    def _tool(self) -> Float64:
        body = self.state.body("tool0")
        return _pose(body.xpos, body.xmat)

    def _tool_speed(self) -> float:
        return float(np.linalg.norm(self.state.body("tool0").cvel[3:]))

    def _view(self, name: str) -> Float64:
        sensor = self.scene.model.sensor(name)
        view: Float64 = self.state.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
        return view


def _pose(position: Float64, rotation: Float64) -> Float64:
    T = np.eye(4)
    T[:3, :3] = rotation.reshape(3, 3)
    T[:3, 3] = position
    return T
