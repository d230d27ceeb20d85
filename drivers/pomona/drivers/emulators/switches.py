"""Fault switches of emulated devices whose faults are attributes: what a name of a fault sets."""

from __future__ import annotations

from collections.abc import Mapping

from pomona.drivers.emulators.suntouch import SunTouchEmulator
from pomona.drivers.emulators.wsg import WsgEmulator
from pomona.drivers.faults import FaultSwitch
from pomona.drivers.wsg.codec import Command, SystemState

RUNAWAY = 0.02
"""Speed of an opening that nobody commands any more [m/s]."""
HELD = 5
"""So many answers of a slow finger are one measurement: 100 Hz of 500 Hz."""
RESTLESS = 0.2
"""By so much a restless taxel jumps [V]: four times what is a spike."""

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
    """Sets attributes of a device, and back to what they were."""

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
    """Of a gripper's controller: what it does not do, says wrongly, or does by itself."""
    return AttributeSwitch(device, GRIPPER)


def finger_switch(device: SunTouchEmulator) -> AttributeSwitch:
    """Of one finger: what it says wrongly, or not at all."""
    return AttributeSwitch(device, FINGER)
