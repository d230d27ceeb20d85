"""The simulated world behind emulated devices in the run's own process, on the world's own time.

Drivers, codecs and the bytes on the wires are those of real devices; the wires are pipes in this process, and the
drivers' threads take turns as the world makes its steps. So a run is the same each time, however busy the computer is.
"""

from __future__ import annotations

from collections.abc import Mapping

from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.sim_bridge import EmulatedDevices, SightEmulator
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.devices.realsense.stamps import LATENCY
from pomona.drivers import Camera, Cell, ConnectContext, Device, FaultSwitch, HandMemory, HandRecord
from pomona.tools.simulation import TIMESTEP


class VirtualWorld(Device):
    """The simulated cell inside the emulated one: it gives the clock, the wires, the score, and the faults.

    Attributes:
        clock: lets the drivers' threads take turns.
        pipes: where the drivers find their devices, by their addresses.
        hand: memory of the hand from one connection to the next; empty in a new world.
        switches: all fault switches: simulated devices, the arm's controller, and the wires.
    """

    def __init__(self, cell: Cell, choices: Mapping[str, tuple[str, str]], camera: str) -> None:
        """
        Args:
            cell: the simulated one.
            choices: see `EmulatedDevices`.
            camera: its address.
        """
        super().__init__("world")
        self._cell = cell
        emulated = EmulatedDevices(cell, choices)
        self._world = emulated.world
        self.clock = VirtualTime(self._world.clock, TIMESTEP)
        self.pipes: dict[str, Pipe] = {}
        simulated = {
            name: device for name, device in cell.devices.items() if isinstance(device, FaultSwitch)
        }
        self.hand = HandMemory(None, HandRecord())
        self.switches: dict[str, FaultSwitch] = dict(simulated)
        for role, device in emulated.devices.items():
            self.switches |= {
                f"{role}.{name}".rstrip("."): switch for name, switch in device.switches.items()
            }
            for wire in device.wires:
                self._lay(f"{role}.{wire.name}", wire.address, Pipe(wire.emulator, self.clock))
        self._lay(
            "camera.wire", camera, Pipe(SightEmulator(cell.device(Camera)), self.clock, LATENCY)
        )

    def _lay(self, name: str, address: str, pipe: Pipe) -> None:
        self.pipes[address] = self.switches[name] = pipe

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
        """Return the world's own score; see `pomona.tools.simulation.score.Scorer.report`."""
        return self._world.truth()

    def close(self) -> None:
        self._cell.close()
