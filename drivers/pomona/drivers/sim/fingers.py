"""The simulated force/tactile fingers: the pads' contact wrenches at the physics' rate, with a real sensor's errors."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numba
import numpy as np

from pomona.drivers.errors import DeviceLost
from pomona.drivers.interfaces import ForceSensor, Subscription, WrenchSample
from pomona.drivers.sim.finger_faults import DELAYS, LIES
from pomona.drivers.sim.robot import PADS
from pomona.drivers.sim.scene import TIMESTEP
from pomona.drivers.sim.world import FaultyDevice, PhysicsWorld
from pomona.drivers.streams import SILENCE, Belief, WrenchStream
from pomona.executive.values.arrays import Float64

LEVER = 0.01  # torque errors are the force errors at this lever [m]
_NOISE_ROWS = 8192


@numba.njit(cache=True)
def pad_wrench(contact: Float64, site_position: Float64, site_rotation: Float64, wrench: Float64) -> None:
    """Compute the wrench of the fruit on a pad, (6,), in the pad's frame, from the engine's net contact.

    Args:
        contact: net force [N], torque [N·m] and their point [m] that the pad exerts, shape (9,), in the base frame.
        site_position, site_rotation: pad frame's origin, shape (3,) [m], and axes as columns, row-major, shape (9,).
    """
    fx, fy, fz = -contact[0], -contact[1], -contact[2]
    px, py, pz = contact[6] - site_position[0], contact[7] - site_position[1], contact[8] - site_position[2]
    tx = -contact[3] + py * fz - pz * fy
    ty = -contact[4] + pz * fx - px * fz
    tz = -contact[5] + px * fy - py * fx
    for k in range(3):
        a, b, c = site_rotation[k], site_rotation[3 + k], site_rotation[6 + k]
        wrench[k] = a * fx + b * fy + c * fz
        wrench[3 + k] = a * tx + b * ty + c * tz


class SimFingers(FaultyDevice):
    """Two pads. Errors: a constant bias per channel, white noise, and the range's end.

    Faults: `lost` (no more samples), and every one of `finger_faults.LIES` and `DELAYS`.
    """

    interfaces = (ForceSensor,)
    known_faults = ("lost", *LIES, *DELAYS)
    rate = 1.0 / TIMESTEP

    def __init__(
        self, world: PhysicsWorld, noise: float, bias: float, force_range: float, belief: Belief | None = None
    ) -> None:
        super().__init__("fingers")
        self._world, self._range = world, force_range
        rng = np.random.default_rng([world.seed, 3])
        scale = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
        offset = rng.uniform(-bias, bias, (2, 6)) * scale
        # A long ring of noise, indexed by the sample's number: independent of listeners, and fast.
        self._errors = offset + rng.normal(0.0, noise, (_NOISE_ROWS, 2, 6)) * scale
        self._contacts = [world.sensor(f"wrench_{pad}") for pad in PADS]
        sites = [world.model.site(pad).id for pad in PADS]
        self._positions = [world.state.site_xpos[site] for site in sites]
        self._rotations = [world.state.site_xmat[site] for site in sites]
        self._passing = WrenchStream(world.clock, belief=belief)
        self._lost: WrenchSample | None = None
        self._before: WrenchSample | None = None
        self._line: deque[WrenchSample] = deque()
        self._passed = -1  # the step of the last measured sample
        world.after_step.append(self._stream)

    def latest(self) -> WrenchSample | None:
        self._pass_on()
        return self._passing.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._passing.subscribe(listener)

    def check(self) -> None:
        if self._lost is not None and self._world.clock.now() - self._lost.stamp > SILENCE:
            raise DeviceLost(self.name, f"no sample for {1e3 * (self._world.clock.now() - self._lost.stamp):.0f} ms")
        problem = self._passing.problem(self.name)
        if problem is not None:
            raise problem

    def link(self) -> str:
        problem = self._passing.problem(self.name)
        return super().link() if problem is None else problem.message

    def acknowledge(self) -> None:
        """Acknowledge the fault of the samples. Raises DeviceFault: it persists."""
        self._pass_on()  # without listeners the recovery of the samples has not been noted
        self._passing.acknowledge(self.name)

    def inject_fault(self, kind: str) -> None:
        newest = self._measure()
        super().inject_fault(kind)
        self._before = newest
        self._line.clear()
        self._lost = newest if kind == "lost" else None

    def clear_fault(self) -> None:
        super().clear_fault()
        self._lost = None

    def _stream(self) -> None:
        if self._passing.has_listeners or self.fault is not None:  # a fault is found whether or not anybody listens
            self._pass_on()

    def _pass_on(self) -> None:
        step = self._world.clock.steps
        if self._passed == step or self.fault == "lost":
            return
        self._passed = step
        sample = self._measure()
        if self.fault in DELAYS:
            arrived = DELAYS[self.fault].pass_on(self._line, sample)
            if arrived is None:
                return
            sample = arrived
        if self.fault in LIES and self._before is not None:
            sample = LIES[self.fault](sample, self._before)
        self._passing.deliver(sample)

    def _measure(self) -> WrenchSample:
        sequence = self._world.clock.steps
        wrenches = np.empty((2, 6))
        for i in range(2):
            pad_wrench(self._contacts[i], self._positions[i], self._rotations[i], wrenches[i])
        wrenches += self._errors[sequence % _NOISE_ROWS]
        forces = wrenches[:, :3]
        beyond = np.abs(forces) >= self._range
        saturated = (False, False)
        if beyond.any():
            np.clip(forces, -self._range, self._range, out=forces)
            saturated = (bool(beyond[0].any()), bool(beyond[1].any()))
        return WrenchSample(sequence * TIMESTEP, sequence, wrenches, saturated)
