"""The conveyor in time: the belt runs, fruit comes at its upper end, and fruit that has left comes again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.applications.conveyor.belt_model import BeltModel, waiting_place
from pomona.applications.conveyor.fates import BeltScore
from pomona.executive import Float64
from pomona.tools.simulation import TIMESTEP, PhysicsWorld, load_mujoco, quaternion, standing_pose

SETTLING = 50  # steps for the arm's drives to take up their load before a run
ACCELERATION = 2.0  # of the belt, when its speed is changed [m/s²]
LOOK_EVERY = 25  # steps between two looks for fruit that has left or may come: 50 ms
RESTED = 1.0  # time in a crate without a pad on it after which a fruit comes again [s]
HIGHER = 0.002  # height over the belt from which a fruit is set down [m]


@dataclass(frozen=True, slots=True)
class Feed:
    """How fruit comes: gaps between fruit along the belt and places beside its middle line [m], the share that rolls,
    and the speed at which it rolls over the belt [m/s]."""

    gap: tuple[float, float]
    lateral: float
    rolling: float = 0.0
    roll_speed: tuple[float, float] = (0.05, 0.20)


class ConveyorWorld(PhysicsWorld):
    """A robot beside a belt.

    Attributes:
        wanted_speed: of the belt [m/s]; it changes with `ACCELERATION`.
        speed, travelled: of the belt now [m/s], and how far it has run [m].
    """

    def __init__(
        self,
        built: BeltModel,
        description: Path,
        q_start: Float64,
        seed: int,
        speed: float,
        feed: Feed,
    ) -> None:
        self.built = built
        self.feed = feed
        self.wanted_speed = self.speed = speed
        self.travelled = 0.0
        super().__init__(built.model, description, q_start, seed)
        self.score = BeltScore(built, self.state)
        self._rng = np.random.default_rng([seed, 21])
        self._surface = built.model.geom_surfacevel[built.model.geom("belt").id]
        self._waiting = list(self._rng.permutation(len(built.fruits)))
        self._next_at = 0.0
        self._rests: dict[int, float] = {}
        self.before_step.append(self._run)
        self.invite(built.intruder)

    def pose(self, number: int) -> Float64:
        """T_base_fruit, shape (4, 4)."""
        body = self.state.body(f"fruit_{number}")
        T = np.eye(4)
        T[:3, 3], T[:3, :3] = body.xpos, body.xmat.reshape(3, 3)
        return T

    def jump(self, distance: float) -> None:
        """Carry all that lies on the belt on by a distance at once [m]."""
        self.travelled += distance
        for number in range(len(self.built.fruits)):
            if self.sensor(f"belt_{number}")[0] > 0.0:
                at = int(self.model.joint(f"fruit_{number}").qposadr[0])
                self.state.qpos[at : at + 3] += distance * self.built.belt.direction

    def put(
        self, number: int, along: float, aside: float, yaw: float = 0.0, roll: float | None = None
    ) -> None:
        """Set a fruit on the belt at a place in the belt's frame [m]; it moves with the belt.

        Args:
            yaw: turn about the vertical [rad].
            roll: speed over the belt at which it comes lying and rolls [m/s]; None: it stands, or lies as its kind.
        """
        fruit = self.built.fruits[number]
        belt = self.built.belt
        lies = fruit.tilt > 1.0 or roll is not None
        across = fruit.dimensions[0] if lies else fruit.dimensions[1]
        T = standing_pose(fruit, belt.top + across / 2.0 + HIGHER)
        c = np.cos(yaw)
        s = np.sin(yaw)
        T[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ T[:3, :3]
        if roll is not None and fruit.tilt <= 1.0:  # its axis lies across the belt
            T[:3, :3] = belt.T_base_belt[:3, :3] @ np.array(
                [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
            )
        T[:3, 3] = (belt.T_base_belt @ np.array([along, aside, across / 2.0 + HIGHER, 1.0]))[:3]
        spin = 2.0 * (roll or 0.0) / across * belt.T_base_belt[:3, 1]
        self._place(number, T, (self.speed + (roll or 0.0)) * belt.direction, spin)

    def park(self, number: int) -> None:
        """Let a fruit wait on the shelf."""
        fruit = self.built.fruits[number]
        belt = self.built.belt
        across = fruit.dimensions[0] if fruit.tilt > 1.0 else fruit.dimensions[1]
        T = standing_pose(fruit, belt.top + across / 2.0 + HIGHER)
        T[:2, 3] = waiting_place(number)
        self._place(number, T, np.zeros(3), np.zeros(3))

    def give_back(self, number: int) -> None:
        """Let a fruit that was parked come again."""
        self._waiting.append(number)

    def _place(self, number: int, T: Float64, velocity: Float64, spin: Float64) -> None:
        joint = self.model.joint(f"fruit_{number}")
        at = int(joint.qposadr[0])
        dof = int(joint.dofadr[0])
        self.state.qpos[at : at + 3] = T[:3, 3]
        self.state.qpos[at + 3 : at + 7] = quaternion(load_mujoco(), T)
        self.state.qvel[dof : dof + 6] = [*velocity, *(T[:3, :3].T @ spin)]

    def _settle(self) -> None:
        for _ in range(SETTLING):
            self.mujoco.mj_step(self.model, self.state)
        self.state.time = 0.0

    def _run(self) -> None:
        most = ACCELERATION * TIMESTEP
        self.speed += float(np.clip(self.wanted_speed - self.speed, -most, most))
        self._surface[0] = self.speed
        self.travelled += self.speed * TIMESTEP
        if self.clock.steps % LOOK_EVERY == 0:
            self._take_off()
            if self.feed.gap[1] > 0.0 and self._waiting and self.travelled >= self._next_at:
                self._bring(self._waiting.pop(0))

    def _bring(self, number: int) -> None:
        rng = self._rng
        belt = self.built.belt
        roll = (
            float(rng.uniform(*self.feed.roll_speed)) if rng.random() < self.feed.rolling else None
        )
        aside = rng.uniform(-self.feed.lateral, self.feed.lateral)
        yaw = rng.uniform(-np.pi, np.pi)
        self.put(number, 0.05 - belt.length / 2.0, aside, yaw, roll)
        self.score.begin(number, self.clock.now())
        self._next_at = self.travelled + float(rng.uniform(*self.feed.gap))

    def _take_off(self) -> None:
        belt = self.built.belt
        T_belt_base = np.linalg.inv(belt.T_base_belt)
        for fate in [
            fate for fate in self.score.fates[-len(self.built.fruits) :] if not fate.ending
        ]:
            number = fate.number
            place = T_belt_base @ np.append(self.pose(number)[:3, 3], 1.0)
            crate = "" if self.score.held(number) else self.score.crate_of(number)
            since = self._rests.setdefault(number, self.clock.now()) if crate else self.clock.now()
            ending = crate if self.clock.now() - since > RESTED else ""
            if place[2] < -0.1 and not crate:
                ending = "fell"
            elif place[0] > belt.length / 2.0 - 0.05 and place[2] < 0.1:
                ending = "passed"
            if ending or not crate:
                self._rests.pop(number, None)
            if ending:
                self.score.end(number, ending)
                self.park(number)
                self.give_back(number)
