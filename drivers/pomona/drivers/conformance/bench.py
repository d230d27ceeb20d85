"""What every bench has: time that moves the device, a wire that can be harmed, and steps of the driver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pomona.drivers.errors import DeviceError
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.cell.owner import Link
from pomona.executive.clock import Clock, ManualClock

STEP = 2e-3  # of a bench's time [s]


class BenchClock(ManualClock):
    """Time that moves a device also while its driver waits.

    Attributes:
        each_step: called with the time [s] after each step.
    """

    def __init__(self, start: float = 20.0) -> None:
        super().__init__(start)
        self.each_step: list[Callable[[float], None]] = []

    def advance(self, duration: float) -> None:
        """Let time pass in whole steps of 2 ms."""
        for _ in range(max(round(duration / STEP), 1) if duration > 0.0 else 0):
            super().advance(STEP)
            for each in self.each_step:
                each(self.now())


class Wire(FaultSwitch):
    """The way of the bytes between a driver and a device.

    Faults: `mute` (the device hears and is not heard), `dead` (no byte either way), `deaf` (it does not hear), `half` (a
    message comes in two parts), `noise` (of what it says, each byte is another), `cut` (connections break, and none can
    be opened).
    """

    known_faults = ("mute", "dead", "deaf", "half", "noise", "cut")

    def __init__(self, to_device: Callable[[], Link], *, keeps: bool = True) -> None:
        """
        Args:
            to_device: opens a connection to the device.
            keeps: it brings later what it does not bring now, as TCP does; a serial line loses it.
        """
        super().__init__()
        self.keeps = keeps
        self._to_device = to_device

    def open(self) -> Link:
        """Return a new connection for the driver. Raises ConnectionRefusedError: the wire is cut."""
        if self.fault == "cut":
            raise ConnectionRefusedError("the wire is cut")
        return _End(self, self._to_device())


class _End:
    """The driver's end of a connection."""

    def __init__(self, wire: Wire, link: Link) -> None:
        self._wire = wire
        self._link = link
        self._unsent = self._unheard = b""
        self._is_cut = False

    def send(self, chunk: bytes) -> None:
        self._need_wire()
        self._unsent += chunk
        kept = self._unsent if self._wire.keeps else b""
        if self._wire.fault not in ("dead", "deaf"):
            self._link.send(self._unsent)
            kept = b""
        self._unsent = kept

    def receive(self, timeout: float) -> bytes:
        self._need_wire()
        if self._unsent and self._wire.fault not in ("dead", "deaf"):
            self.send(b"")
        chunk = self._unheard + self._link.receive(timeout)
        if chunk and self._wire.fault in ("mute", "dead"):
            chunk += self._link.receive(timeout)  # who hears nothing waits for it
        fault = self._wire.fault
        size = len(chunk)
        if fault in ("mute", "dead"):
            size = 0
        elif fault == "half" and chunk:
            size //= 2
            self._wire.clear_fault()
        self._unheard = chunk[size:] if self._wire.keeps else b""
        heard = chunk[:size]
        return bytes(byte ^ 0x5A for byte in heard) if fault == "noise" else heard

    def close(self) -> None:
        self._link.close()

    def _need_wire(self) -> None:
        self._is_cut = self._is_cut or self._wire.fault == "cut"
        if self._is_cut:
            raise ConnectionResetError("the wire is cut")


class Bench:
    """A driver and its device on one time.

    Attributes:
        device: the driver, connected, without a thread of its own.
        harms: what can happen to it, by word.
        each_step: called after each step.
    """

    def __init__(
        self, device: Any, clock: Clock, *switches: FaultSwitch, without: tuple[str, ...] = ()
    ) -> None:
        """
        Args:
            clock: the driver's. A clock of a simulation moves the device, too.
            switches: of its wire and of the device, by which it can be harmed.
            without: faults of these that no driver could notice.
        """
        self.device = device
        self.clock = clock
        self.harms: Mapping[str, FaultSwitch] = {
            fault: switch
            for switch in switches
            for fault in switch.known_faults
            if fault not in without
        }
        self.each_step: list[Callable[[], None]] = []

    @property
    def now(self) -> float:
        """Time [s]."""
        return self.clock.now()

    def harm(self, kind: str, seconds: float) -> None:
        """Let something happen to the device, and time pass; an empty word is no harm."""
        if kind:
            self.harms[kind].inject_fault(kind)
        self.serve(seconds)

    def heal(self) -> None:
        """The harms have passed."""
        for switch in self.harms.values():
            if switch.fault is not None:
                switch.clear_fault()

    def step(self) -> None:
        """Let the driver do one step, if it has a thread, and the cell look after it; some time passes."""
        before = self.now
        getattr(self.device, "step", self.problem)()
        if self.now == before:
            self.clock.advance(STEP)

    def serve(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let time pass while the driver works, until something has come about."""
        end = self.now + seconds
        while self.now < end - 1e-9 and not until():
            self.step()
            for each in self.each_step:
                each()

    def stand_still(self, seconds: float) -> None:
        """Let the driver's process stand still; only the device goes on."""
        self.clock.advance(seconds)

    def problem(self) -> str:
        """Return what the driver reports; empty without a problem."""
        try:
            self.device.check()
        except DeviceError as error:
            return str(error)
        return ""
