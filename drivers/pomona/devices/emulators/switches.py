"""Fault switches of emulated devices whose faults are attributes: the attribute that each fault sets."""

from __future__ import annotations

from collections.abc import Mapping

from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.wsg.codec import Command, SystemState
from pomona.drivers import FaultSwitch

RUNAWAY = 0.02  # speed of an opening without a command [m/s]
HELD = 5  # number of answers of a slow finger with one measurement: 100 Hz of 500 Hz
RESTLESS = 0.2  # jump of a restless taxel [V]: four times the threshold of a spike

GRIPPER: dict[str, dict[str, object]] = {
    "lost": {"silent": True},
    "faulty": {"faults": SystemState.TEMPERATURE | SystemState.POWER | SystemState.CURRENT | SystemState.FINGER_FAULT},
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
        self._device, self._faults = device, faults
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
