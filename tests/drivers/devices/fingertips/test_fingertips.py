"""TSF-85 fingertips: packets, Robotiq's own client, and the driver against the emulator on a moved clock."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.devices.fingertips.codec import TAXELS, autosend, take_packets
from pomona.devices.fingertips.connect import connect
from pomona.devices.fingertips.driver import TsfFingertips, TsfSession
from pomona.devices.laboratory_emulators.tsf85 import COUNT, Tsf85Emulator
from pomona.devices.wrist_sensors.sensor import RECONNECT, StreamOptions
from pomona.drivers import CellFileError, ConnectContext, DeviceFault, DeviceLost, PressSensor
from pomona.executive import ManualClock, SystemClock
from pomona.tools.mock import MockClock, MockGripper
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.motoman.test_driver import Connection


def packet(rows: Any) -> bytes:
    """Return the packet with the taxels of both fingers."""
    body = b"".join(
        bytes([0x10 + 4 * i, *np.array(row, ">u2").tobytes()]) for i, row in enumerate(rows)
    )
    return bytes([0x9A, 0, 0x61, len(body)]) + body


ROWS = st.lists(st.integers(0, 65535), min_size=TAXELS, max_size=TAXELS)


class Cell:
    def __init__(self) -> None:
        self.clock = ManualClock(30.0)
        self.cut, self.forces = False, (0.0, 0.0)
        self.device = Tsf85Emulator(lambda: self.forces)
        self.opened: list[Connection] = []

    def open(self, zero: tuple[float, float] | None = None) -> TsfSession:
        if self.cut:
            raise ConnectionRefusedError("nothing answers")
        self.opened.append(Connection(self, self.device))  # type: ignore[arg-type]
        return TsfSession("fingertips", self.opened[-1], self.clock, 0.01, COUNT, zero)

    def let_pass(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while not until() and self.clock.now() < end - 1e-9:
            self.clock.advance(0.001)
            self.device.advance(self.clock.now())


def connected(cell: Cell) -> TsfFingertips:
    fingertips = TsfFingertips(cell.open, cell.clock, StreamOptions(100.0, 0.1, 50.0), "fingertips")
    fingertips.connect()
    return fingertips


def serve(fingertips: TsfFingertips, cell: Cell, seconds: float) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end:
        before = cell.clock.now()
        fingertips.step()
        if cell.clock.now() == before:
            cell.let_pass(0.001)


@given(st.lists(st.tuples(ROWS, ROWS), max_size=3), st.integers(1, 70))
def test_packets_are_found_again_whatever_the_pieces_of_the_stream(
    rows: list[Any], size: int
) -> None:
    stream = b"".join(map(packet, rows))
    buffer, found = bytearray(), []
    for start in range(0, len(stream), size):
        buffer += stream[start : start + size]
        found += take_packets(buffer)[0]
    assert [[one[0].tolist(), one[1].tolist()] for one in found] == [
        list(map(list, both)) for both in rows
    ]


@given(st.binary(max_size=400))
def test_no_bytes_raise(garbage: bytes) -> None:
    take_packets(bytearray(garbage))


def test_robotiqs_own_client_reads_the_emulator() -> None:
    protocol = pytest.importorskip("pyrobotiqtactile.protocol")
    assert autosend(10) == protocol.PacketParser.build_autosend_command(10)
    cell, parser = Cell(), protocol.PacketParser()
    link = Connection(cell, cell.device)  # type: ignore[arg-type]
    link.send(parser.build_autosend_command(20))
    cell.forces = (0.0, 3.0)
    (first, *_) = parser.feed(link.receive(0.05))
    assert parser.parse_sensor_packet(first) == [True, True]
    left, right = (sum(finger.static_tactile) for finger in parser.fingers)
    assert COUNT * (right - left) == pytest.approx(3.0, abs=0.02)


def test_the_pressing_forces_are_measured_from_the_zero_of_the_empty_hand() -> None:
    cell = Cell()
    fingertips = connected(cell)
    assert isinstance(fingertips, PressSensor)
    np.testing.assert_allclose(fingertips.latest().wrenches, 0.0, atol=0.02)
    cell.forces = (2.0, 3.5)
    serve(fingertips, cell, 0.2)
    np.testing.assert_allclose(fingertips.latest().wrenches[:, 2], [-2.0, -3.5], atol=0.02)
    assert not fingertips.latest().wrenches[:, [0, 1, 3, 4, 5]].any()
    fingertips.check()


@pytest.mark.parametrize("fault", ["silent", "garbage"])
def test_fingertips_that_give_no_packet_are_lost_until_they_are_acknowledged(fault: str) -> None:
    cell = Cell()
    fingertips = connected(cell)
    cell.device.inject_fault(fault)
    serve(fingertips, cell, 0.12)
    with pytest.raises(DeviceLost):
        fingertips.check()
    cell.device.clear_fault()
    serve(fingertips, cell, RECONNECT + 3.0)
    with pytest.raises(DeviceLost):
        fingertips.check()
    fingertips.acknowledge()
    fingertips.check()


def test_fingertips_that_repeat_their_value_are_faulty() -> None:
    cell = Cell()
    fingertips = connected(cell)
    cell.device.inject_fault("stuck")
    serve(fingertips, cell, 0.2)
    with pytest.raises(DeviceFault, match="both fingers have reported"):
        fingertips.check()


def open_fingertips(folder: Path, text: str, width: float, cleared: bool = False) -> None:
    path = folder / "cell.yaml"
    path.write_text(f"driver: robotiq-tsf85\n{text}\n")
    devices = {"gripper": MockGripper(MockClock(), width)}
    context = ConnectContext(path, SystemClock(), 0, cleared=cleared, devices=devices)
    connect.connect(read_settings(connect, path), context)


@pytest.mark.parametrize(
    ("text", "width", "cleared", "words"),
    [
        (
            "port: /dev/none\ncount: 0.2 mN",
            0.05,
            False,
            r"(?s):2:7: .*zero cannot be taken.*--cleared",
        ),
        ("port: /dev/none\ncount: 0.2 mN", 0.05, True, r"(?s):2:7: .*cannot be reached"),
        (
            "port: /dev/none\ncount: 0.2 mN\nzero: [25200, 25200]",
            0.05,
            False,
            r"(?s):2:7: .*cannot be reached",
        ),
        ("port: /dev/none", 0.05, True, "count"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(
    tmp_path: Path, text: str, width: float, cleared: bool, words: str
) -> None:
    with pytest.raises(CellFileError, match=words):
        open_fingertips(tmp_path, text, width, cleared)
