"""The simulated load sensor: the wrench between flange and hand, with noise, 100 times a second."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pomona.drivers import (
    SILENCE,
    ConnectContext,
    DeviceError,
    DeviceLost,
    LoadSensor,
    Settings,
    Subscription,
    Surroundings,
    WrenchSample,
    WrenchStream,
    driver,
)
from pomona.executive import FORCE, MASS, Float64, Measure, Problem, value
from pomona.tools.simulation import TIMESTEP, FaultyDevice, PhysicsWorld

STEPS = 5  # of the physics from sample to sample: 100 Hz, as a Robotiq FT 300
LEVER = 0.03  # torque errors are the force errors at this lever [m]


class SimLoadSensor(FaultyDevice):
    """The hand's wrench on the flange, in tool0. Faults: `lost` (no more samples), `stuck` (the same again), `zero`."""

    interfaces = (LoadSensor,)
    known_faults = ("lost", "stuck", "zero")
    rate = 1.0 / (STEPS * TIMESTEP)

    def __init__(self, world: PhysicsWorld, noise: float, mass: float, least: float) -> None:
        super().__init__("load")
        self.mass = mass
        self.least = least
        self._world = world
        self._noise = noise
        self._hand = world.model.body("tool0").id
        self._rng = np.random.default_rng([world.seed, 17])
        self._silence = max(SILENCE, 4.0 / self.rate)
        self._passing = WrenchStream(world.clock, self._silence, sides=("the load sensor",))
        self._before: Float64 | None = None
        world.after_step.append(self._stream)

    def latest(self) -> WrenchSample | None:
        return self._passing.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._passing.subscribe(listener)

    def check(self) -> None:
        newest = self._passing.newest
        now = self._world.clock.now()
        if newest is not None and now - newest.stamp > self._silence and self.fault == "lost":
            raise DeviceLost(self.name, f"no sample for {1e3 * (now - newest.stamp):.0f} ms")
        super().check()

    def _wrong(self) -> DeviceError | None:
        return self._passing.problem(self.name)

    def acknowledge(self) -> None:
        """Acknowledge the fault of the samples. Raises DeviceFault: it persists."""
        self._passing.acknowledge(self.name)

    def _stream(self) -> None:
        step = self._world.clock.steps
        if step % STEPS or self.fault == "lost":
            return
        wrench = (
            self._before if self.fault == "stuck" and self._before is not None else self._measure()
        )
        if self.fault == "zero":
            wrench = np.zeros(6)
        self._before = wrench
        self._passing.deliver(WrenchSample(step * TIMESTEP, step // STEPS, wrench[None, :]))

    def _measure(self) -> Float64:
        """The wrench on the flange in tool0, (6,): the engine computes that of the flange on the hand."""
        world = self._world
        world.mujoco.mj_rnePostConstraint(world.model, world.state)
        axes = world.state.xmat[self._hand].reshape(3, 3)
        spatial = np.array(
            world.state.cfrc_int[self._hand]
        )  # torque about the subtree's centre of mass, force
        force = -spatial[3:]
        centre = world.state.subtree_com[world.model.body_rootid[self._hand]]
        torque = -spatial[:3] + np.cross(centre - world.state.xpos[self._hand], force)
        errors = self._rng.normal(0.0, self._noise, 6) * np.array(
            [1.0, 1.0, 1.0, LEVER, LEVER, LEVER]
        )
        measured: Float64 = np.concatenate([axes.T @ force, axes.T @ torque]) + errors
        return measured


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadOptions:
    """The simulated load sensor between flange and hand."""

    noise: float = value(Measure(FORCE, "0 N", "10 N"), "0.1 N", "white, per sample")
    mass: float = value(
        Measure(MASS, "10 g", "30 kg"), "1.5 kg", "mass that it carries: hand, camera and fruit"
    )
    least: float = value(
        Measure(FORCE, "0 N", "50 N"), "0.5 N", "smallest lasting change that is no error of it"
    )

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not around.has(PhysicsWorld):
            yield Problem(
                "driver", "it needs the simulated world above it", "world: {driver: mujoco, …}"
            )


@driver(SimLoadSensor, LoadOptions)
def connect(settings: Settings[LoadOptions], context: ConnectContext) -> SimLoadSensor:
    """`driver: sim-load`"""
    said = settings.values
    world = context.find(PhysicsWorld)
    assert world is not None, "judged when the cell file was read"
    return SimLoadSensor(world, said.noise, said.mass, said.least)
