"""Settings of a cell file, and a gripper over a pseudo terminal and the URCap's socket."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.server import PtyPort, Server, TcpPort
from pomona.devices.laboratory_emulators.robotiq import RobotiqEmulator
from pomona.devices.robotiq import outside
from pomona.devices.robotiq.connect import connect
from pomona.devices.robotiq.driver import RobotiqGripper
from pomona.devices.robotiq.options import RobotiqFile
from pomona.drivers import CellFileError, ConnectContext, GripperLimits, MotionState
from pomona.executive import SystemClock
from tests.drivers.device_settings import read_settings


@contextlib.contextmanager
def served(gripper: RobotiqEmulator, port: Any) -> Iterator[str]:
    done = threading.Event()
    server = Server([port], [gripper], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    try:
        yield port.address
    finally:
        done.set()
        thread.join(5.0)


def open_gripper(folder: Path, text: str, cleared: bool = False) -> RobotiqGripper:
    path = folder / "cell.yaml"
    path.write_text(f"driver: robotiq\n{text}\n")
    return connect.connect(
        read_settings(connect, path), ConnectContext(path, SystemClock(), 0, cleared=cleared)
    )


@pytest.mark.realtime
@pytest.mark.parametrize("way", ["port", "urcap"])
def test_it_moves_over_its_wire_and_is_stopped_from_outside(tmp_path: Path, way: str) -> None:
    gripper = RobotiqEmulator(FreeGripper(time.monotonic, 0.068))
    port = (
        PtyPort(gripper.rtu, tmp_path / "gripper")
        if way == "port"
        else TcpPort(gripper.urcap, clients=2)
    )
    with served(gripper, port) as address:
        hand = open_gripper(tmp_path, f"model: hand-e\n{way}: '{address}'\nsilence: 2 s")
        move = hand.move(0.030, 0.05)
        end = time.monotonic() + 10.0
        while not move.settled and time.monotonic() < end:
            SystemClock().advance(0.005)
        assert (move.state, move.problem) == (MotionState.DONE, "")
        hand.move(0.010, 0.02)
        time.sleep(0.3)
        assert hand.outside_stop is not None
        place, arguments = hand.outside_stop
        assert place == f"{outside.__name__}:stop"
        hand.close()
        gripper.written[0] |= 8  # as a process leaves it that has ended in a move
        gripper.written[3] = 230
        outside.stop(*arguments)
        assert not gripper.written[0] & 8


@pytest.mark.realtime
def test_a_gripper_at_another_modbus_address_is_served_and_stopped_there(tmp_path: Path) -> None:
    gripper = RobotiqEmulator(FreeGripper(time.monotonic, 0.068))
    gripper.units = range(12, 13)
    with served(gripper, PtyPort(gripper.rtu, tmp_path / "gripper")) as address:
        with pytest.raises(CellFileError, match="does not answer"):
            open_gripper(tmp_path, f"model: hand-e\nport: '{address}'")
        hand = open_gripper(tmp_path, f"model: hand-e\nport: '{address}'\nunit: 12\nsilence: 2 s")
        assert hand.state().width == pytest.approx(0.05, abs=0.02)
        assert hand.outside_stop is not None
        hand.close()
        gripper.written[0] |= 8
        outside.stop(*hand.outside_stop[1])
        assert not gripper.written[0] & 8


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("model: hand-e\nport: /dev/nothing", r"(?s):3:7: .*cannot be reached.*Modbus address 9"),
        ("model: hand-e\nurcap: 127.0.0.86", r"(?s):3:8: .*URCap installed"),
        ("model: hand-e\nport: /dev/nothing\nunit: 12", r"(?s):3:7: .*Modbus address 12"),
        ("model: hand-e\nport: /dev/x\nunit: 0", r":4:7: .*between 1 and 247"),
        ("model: hand-e\nport: /dev/x\nunit: 248", r":4:7: .*between 1 and 247"),
        ("model: hand-e\nport: /dev/x\nunit: 9.5", "whole number"),
        (
            "model: hand-e\nurcap: 127.0.0.86\nunit: 12",
            r"(?s):4:7: .*no Modbus address.*remove 'unit'",
        ),
        ("model: hand-e\nurcap: '127.0.0.86:'", "is not an address"),
        ("model: hand-f\nport: /dev/x", "did you mean 'hand-e'"),
        ("model: hand-e", "either 'port' or 'urcap'"),
        ("model: 2f-140\nport: /dev/x\nforce: 5 N", "press with 10 N at least and 125 N at most"),
        ("model: hand-e\nport: /dev/x\ncounts: [0, 50]", "about 227 apart"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(CellFileError, match=words):
        open_gripper(tmp_path, text)


def test_the_limits_are_known_before_the_connection() -> None:
    said = RobotiqFile(model="2f-85", port="/dev/x", finger_offset=0.01)
    (limits,) = said.known()
    assert isinstance(limits, GripperLimits)
    assert (limits.width_max, limits.force_min, limits.force_max) == (
        pytest.approx(0.095),
        20.0,
        20.0,
    )
    assert limits.step == pytest.approx(0.085 / 227)
