import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from pomona.devices.emulators.free_gripper import FreeGripper
from pomona.devices.emulators.server import CanPort, Endpoint, Server, TcpPort
from pomona.devices.emulators.wsg import WsgEmulator
from pomona.devices.wsg.codec import Move, encode
from pomona.devices.wsg.connect import connect
from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.outside import stop_on_can
from pomona.devices.wsg.transport import CanLink, can_channels
from pomona.drivers.errors import CellFileError
from pomona.drivers.interfaces import MotionState
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import SystemClock
from tests.drivers.device_settings import read_settings


def serving(port: Endpoint, device: WsgEmulator) -> Iterator[str]:
    done = threading.Event()
    server = Server([port], [device], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    yield port.address
    done.set()
    thread.join(2.0)


@pytest.fixture
def tcp() -> Iterator[str]:
    device = WsgEmulator(FreeGripper(time.monotonic))
    yield from serving(TcpPort(device), device)


@pytest.fixture
def bus() -> Iterator[str]:
    device = WsgEmulator(FreeGripper(time.monotonic))
    yield from serving(
        CanPort(device, can.Bus("wsg-test", interface="virtual"), reply_id=7), device
    )


def open_gripper(folder: Path, text: str) -> WsgGripper:
    path = folder / "cell.yaml"
    path.write_text(f"driver: wsg\nfinger_offset: 35 mm\nsilence: 900 ms\n{text}\n")
    return connect.connect(read_settings(connect, path), ConnectContext(path, SystemClock(), 0))


def moves(gripper: WsgGripper) -> bool:
    motion = gripper.move(0.070, 0.2)
    end = time.monotonic() + 5.0
    while not motion.settled and time.monotonic() < end:
        SystemClock().advance(0.005)
    gripper.close()
    return motion.state is MotionState.DONE


@pytest.mark.realtime
def test_it_moves_over_tcp(tmp_path: Path, tcp: str) -> None:
    assert moves(open_gripper(tmp_path, f"tcp: '{tcp}'"))


@pytest.mark.realtime
def test_it_moves_over_a_can_bus_with_the_reply_id_of_the_cell_file(
    tmp_path: Path, bus: str
) -> None:
    assert moves(
        open_gripper(tmp_path, "can: {interface: virtual, channel: wsg-test, reply_id: 7}")
    )


def test_the_wrong_reply_id_is_a_gripper_that_does_not_answer(tmp_path: Path, bus: str) -> None:
    with pytest.raises(CellFileError, match="INFO was not answered") as caught:
        open_gripper(tmp_path, "can: {interface: virtual, channel: wsg-test, reply_id: 8}")
    assert caught.value.line == 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tcp: '127.0.0.1:9'", r":4:6: .*cannot be reached"),
        ("tcp: '127.0.0.1:port'", "write HOST, HOST:PORT"),
        ("can: {interface: socketcan, channel: can77}", r"CAN interfaces of this machine"),
        ("can: {interface: carrier-pigeon}", "carrier-pigeon"),
        ("can: {reply_id: 4711}", "must be between 0 and 2047"),
        ("{}", "either 'tcp' or 'can'|not YAML"),
        ("tcp: h\ncan: {}", "either 'tcp' or 'can'"),
        ("tcp: h\nsoft_limits: [10 mm, 90 mm]", "cannot lie below finger_offset"),
        ("tcp: h\nwatchdog: 100 mm", "'mm' is no unit of time"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(CellFileError, match=words):
        open_gripper(tmp_path, text)


def test_can_interfaces_are_found_by_their_hardware_type(tmp_path: Path) -> None:
    for name, kind in (("can0", "280"), ("eth0", "1"), ("vcan0", "280")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
    assert can_channels(tmp_path) == ["can0", "vcan0"]


def test_another_process_stops_it_over_its_own_end_of_the_bus() -> None:
    """The process that moved it is gone; its supervisor opens the bus anew, and the fingers stay at their place."""
    hand = FreeGripper(time.monotonic, width=0.060)
    device = WsgEmulator(hand)
    port = CanPort(device, can.Bus("wsg-outside", interface="virtual"), reply_id=7)
    mover = CanLink.open("virtual", "wsg-outside", 500_000, 1, 7)
    mover.send(encode(Move(0.010, 0.005)))
    served = serving(port, device)
    next(served)
    try:
        while hand.state().speed == 0.0:
            time.sleep(1e-3)
        stop_on_can("virtual", "wsg-outside", 500_000, 1, 7)
        assert hand.state().speed == 0.0
        assert 0.050 < hand.state().width < 0.060
    finally:
        next(served, None)
        mover.close()


def test_a_bus_without_an_answer_is_reported_as_such() -> None:
    with pytest.raises(OSError, match="did not answer the stop"):
        stop_on_can("virtual", "wsg-silent", 500_000, 1, 7)
