"""WSG and SUNTouch in an emulated cell, with their fault switches: the attribute that each fault sets."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.wsg.codec import Command, SystemState
from pomona.drivers import Cell, FaultSwitch, ForceSensor, Gripper
from pomona.executive import Float64

RUNAWAY = 0.02  # speed of an opening without a command [m/s]
HELD = 5  # number of answers of a slow finger with one measurement: 100 Hz of 500 Hz
RESTLESS = 0.2  # jump of a restless taxel [V]: four times the threshold of a spike

GRIPPER: dict[str, dict[str, object]] = {
    "lost": {"silent": True},
    "faulty": {
        "faults": SystemState.TEMPERATURE
        | SystemState.POWER
        | SystemState.CURRENT
        | SystemState.FINGER_FAULT
    },
    "busy": {"busy": True},
    "frozen": {"frozen": True},
    "opens": {"runaway": RUNAWAY},
    "closes": {"runaway": -RUNAWAY},
    "refuses": {"refusing": {Command.MOVE, Command.SCRIPT_SPEED}},
    "refuses_stop": {"refusing": {Command.STOP}},
    "deaf": {"deaf": set(Command)},
}
FINGER: dict[str, dict[str, object]] = {
    "lost": {"silent": True},
    "stuck": {"stuck": True},
    "dead": {"dead": True},
    "restless": {"restless": RESTLESS},
    "slow": {"held": HELD},
}


class AttributeSwitch(FaultSwitch):
    """Sets attributes of a device, and restores their values."""

    def __init__(self, device: object, faults: Mapping[str, Mapping[str, object]]) -> None:
        super().__init__()
        self.known_faults = tuple(faults)
        self._device = device
        self._faults = faults
        self._before: dict[str, object] = {}

    def inject_fault(self, kind: str) -> None:
        self.clear_fault()
        super().inject_fault(kind)
        for name, value in self._faults[kind].items():
            self._before[name] = getattr(self._device, name)
            setattr(self._device, name, value)

    def clear_fault(self) -> None:
        super().clear_fault()
        while self._before:
            setattr(self._device, *self._before.popitem())


def gripper_switch(device: WsgEmulator) -> AttributeSwitch:
    """Return the switch of a gripper's controller: omitted, wrong and unrequested actions."""
    return AttributeSwitch(device, GRIPPER)


def finger_switch(device: SunTouchEmulator) -> AttributeSwitch:
    """Return the switch of one finger: wrong or missing readings."""
    return AttributeSwitch(device, FINGER)


def _make_wsg(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    gripper = cell.device(Gripper)
    device = WsgEmulator(gripper, finger_offset=gripper.limits.width_min)
    wires = (EmulatedWire("wire", addresses[0], device),)
    return EmulatedDevice(wires, device.advance, {"controller": gripper_switch(device)})


def _wrench(fingers: ForceSensor, side: int) -> Float64:
    sample = fingers.latest()
    return np.zeros(6) if sample is None else sample.wrenches[side]


def _finger_ports(folder: str) -> tuple[str, ...]:
    return tuple(str(Path(folder) / f"finger_{side}") for side in ("left", "right"))


def _make_suntouch(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    fingers = cell.device(ForceSensor)
    pads = [SunTouchEmulator(partial(_wrench, fingers, side), seed=side) for side in (0, 1)]
    fingers.latest()  # its first sample compiles code; later samples must not wait for that
    sides = ("left", "right")
    wires = (
        EmulatedWire(f"{side}_wire", address, pad)
        for side, address, pad in zip(sides, addresses, pads, strict=True)
    )
    switches = {side: finger_switch(pad) for side, pad in zip(sides, pads, strict=True)}
    return EmulatedDevice(tuple(wires), lambda now: None, switches)


WSG = EmulatorKind(lambda address: (address,), _make_wsg)
SUNTOUCH = EmulatorKind(_finger_ports, _make_suntouch)
