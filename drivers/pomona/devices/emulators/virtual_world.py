"""The simulated world behind emulated devices in the run's own process, on the world's own time.

Drivers, codecs and the bytes on the wires are those of real devices; the wires are pipes in this process, and the
drivers' threads take turns as the world makes its steps. So a run is the same each time, however busy the computer is.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.sim_bridge import EmulatedDevices, SightEmulator
from pomona.devices.emulators.switches import finger_switch, gripper_switch
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.devices.motoman.codec import Order
from pomona.devices.realsense.stamps import LATENCY
from pomona.drivers import Camera, Cell, ConnectContext, Device, FaultSwitch, HandMemory, HandRecord
from pomona.drivers.sim import TIMESTEP


class VirtualWorld(Device):
    """The simulated cell inside the emulated one: it gives the clock, the wires, the score, and the faults.

    Attributes:
        clock: lets the drivers' threads take turns.
        pipes: where the drivers find their devices, by their addresses.
        hand: memory of the hand from one connection to the next; empty in a new world.
        switches: all fault switches: simulated devices, the arm's controller, and the wires.
    """

    def __init__(self, cell: Cell, order: Order, addresses: Mapping[str, tuple[str, int]], fingers: Path) -> None:
        """
        Args:
            cell: the simulated one.
            order: of bytes at the arm's controller.
            addresses: host and port of arm, gripper and camera.
            fingers: folder in which the lines finger_left and finger_right seem to be.
        """
        super().__init__("world")
        self._cell = cell
        devices = EmulatedDevices(cell, order)
        self._world = devices.world
        self.clock = VirtualTime(self._world.clock, TIMESTEP)
        host, port = addresses["arm"]
        motion, state = (Pipe(p, self.clock) for p in (devices.controller.motion, devices.controller.state))
        gripper = Pipe(devices.hand, self.clock)
        left, right = (Pipe(pad, self.clock) for pad in devices.pads)
        camera = Pipe(SightEmulator(cell.device(Camera)), self.clock, LATENCY)
        self.pipes = {
            f"{host}:{port}": motion,
            f"{host}:{port + 1}": state,
            _text(addresses["gripper"]): gripper,
            _text(addresses["camera"]): camera,
            str(fingers / "finger_left"): left,
            str(fingers / "finger_right"): right,
        }
        simulated = {name: device for name, device in cell.devices.items() if isinstance(device, FaultSwitch)}
        self.hand = HandMemory(None, HandRecord())
        self.switches: dict[str, FaultSwitch] = simulated | {
            "arm": devices.controller,
            "arm.motion_wire": motion,
            "arm.state_wire": state,
            "gripper.controller": gripper_switch(devices.hand),
            "gripper.wire": gripper,
            "fingers.left": finger_switch(devices.pads[0]),
            "fingers.right": finger_switch(devices.pads[1]),
            "fingers.left_wire": left,
            "fingers.right_wire": right,
            "camera.wire": camera,
        }

    def enter(self, context: ConnectContext) -> None:
        """Let drivers that are connected from now on find the devices of this world and the memory of its hand."""
        context.wires |= {address: pipe.open for address, pipe in self.pipes.items()}
        context.hand = self.hand

    def hang_up(self) -> None:
        """Cut every connection and end the drivers' threads, as if their process had been killed."""
        self.clock.turns.clear()
        for pipe in self.pipes.values():
            pipe.hang_up()

    def truth(self) -> Mapping[str, object]:
        """Return the world's own score; see `pomona.drivers.sim.score.Scorer.report`."""
        return self._world.truth()

    def close(self) -> None:
        self._cell.close()


def _text(address: tuple[str, int]) -> str:
    host, port = address
    return f"{host}:{port}"
