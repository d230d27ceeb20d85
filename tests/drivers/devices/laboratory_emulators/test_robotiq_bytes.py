"""The emulated Robotiq gripper answers the examples of the 2F-85's instruction manual with their bytes."""

from __future__ import annotations

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.laboratory_emulators.robotiq import ACTIVATING, RobotiqEmulator
from pomona.executive import ManualClock

WRITTEN = "09 10 03 e8 00 03 01 30"
READ = "09 03 07 d0 00 01 85 cf"


class Peer:
    """The other end of the line."""

    def __init__(self) -> None:
        self.got = b""

    def send(self, chunk: bytes) -> None:
        self.got += chunk

    def close(self) -> None:
        """Nothing follows."""


def test_an_activation_has_the_bytes_of_the_manual() -> None:
    clock, peer = ManualClock(1.0), Peer()
    gripper = RobotiqEmulator(FreeGripper(clock.now), "2f-85")
    gripper.rtu.connected(peer)

    def ask(request: str, wait: float = 0.05) -> str:
        peer.got = b""
        gripper.rtu.received(peer, bytes.fromhex(request))
        clock.advance(wait)
        gripper.advance(clock.now())
        return peer.got.hex(" ")

    assert ask("09 10 03 e8 00 03 06 00 00 00 00 00 00 73 30") == WRITTEN
    assert ask("09 10 03 e8 00 03 06 01 00 00 00 00 00 72 e1") == WRITTEN
    assert ask(READ) == "09 03 02 11 00 55 d5"
    clock.advance(ACTIVATING)
    gripper.advance(clock.now())
    assert ask(READ) == "09 03 02 31 00 4c 15"
