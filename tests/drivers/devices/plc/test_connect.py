"""Settings of a cell file for a PLC: each mistake is one line at its place; and the driver over a real socket."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from pomona.devices.emulators.server import Server, TcpPort
from pomona.devices.laboratory_emulators.modbus_plc import PlcEmulator
from pomona.devices.plc import client, connect as leaf
from pomona.devices.plc.signals import SignalNames
from pomona.drivers import CellFileError, ConnectContext
from pomona.executive import SystemClock
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.plc.plc_rig import PlcRig

USUAL = """\
driver: modbus-signals
address: 127.0.0.86
heartbeat: {output: coil 0, input: discrete 0}
inputs:
  start: {at: discrete 1}
outputs:
  ready: {at: coil 1}
"""


def settings(folder: Path, text: str):
    path = folder / "plc.yaml"
    path.write_text(text)
    return read_settings(leaf.connect, path)


def refusal(folder: Path, text: str, rig: PlcRig | None = None) -> str:
    """The refusal's line; nothing has been written to the PLC."""
    said = settings(folder, text)
    context = ConnectContext(folder / "plc.yaml", rig.clock if rig else SystemClock(), 0)
    if rig is not None:
        context.wires["127.0.0.86:502"] = rig.open
    with pytest.raises(CellFileError) as raised:
        leaf.connect(said, context)
    assert str(raised.value).count("plc.yaml:") == 1
    return str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("discrete 1", "discrete 65536", ":5:15: .*an address from 0 to 65535"),
        ("discrete 1", "relay 1", r":5:15: .*an area \(coil, discrete, holding, input\)"),
        (
            "{at: coil 1}",
            "{at: discrete 1}",
            r":7:15: .*an area that can be written \(coil, holding\)",
        ),
        ("{at: coil 1}", "{at: coil 0}", ":7:3: .*'ready' and 'heartbeat.output' both take coil 0"),
        (
            "{at: coil 1}",
            "{at: coil 1}\n  busy: {at: coil 1}",
            "'busy' and 'ready' both take coil 1",
        ),
        (
            "{at: discrete 1}",
            "{at: discrete 1}\n  stop: {at: discrete 1}",
            ":5:3: .*'stop' and 'start' both take discrete 1",
        ),
        (
            "{at: discrete 1}",
            "{at: input 9}\n  m: {at: input 8, type: float32}",
            "'m' and 'start' both take input 9",
        ),
        (
            "{at: discrete 1}",
            "{at: holding 4, type: float32}\n  m: {at: holding 5, type: int32}",
            "both take holding 5",
        ),
        ("{at: discrete 1}", "{at: coil 1}", "'ready' and 'start' both take coil 1"),
        (
            "input: discrete 0",
            "input: coil 0",
            ":3:12: .*'heartbeat.input' and 'heartbeat.output' both take coil 0",
        ),
        ("input: discrete 0", "input: coil 1", "'ready' and 'heartbeat.input' both take coil 1"),
        (
            "address: 127.0.0.86",
            "address: '127.0.0.86:'",
            r":2:10: .*is not an address: write HOST, HOST:PORT or \[IPv6\]",
        ),
        ("address: 127.0.0.86", "address: '::1'", "is not an address"),
        ("address: 127.0.0.86", "address: '[::1'", "is not an address"),
        ("address: 127.0.0.86", "address: '[:::::]:502'", ":2:10: .*is not an address"),
        ("address: 127.0.0.86", "address: '[1::2::3]'", "is not an address"),
        ("address: 127.0.0.86", "address: '[10.0.0.1]:502'", "is not an address"),
        ("address: 127.0.0.86", "address: '[fe80::1%]'", "is not an address"),
        ("address: 127.0.0.86", "address: http://127.0.0.86", "is not an address"),
        ("address: 127.0.0.86", "address: 127.0.0.86:65536", "is not an address"),
        ("{at: coil 1}", "{at: coil 1, safe: 2}", ":7:29: .*no value of a switch"),
        ("{at: coil 1}", "{at: holding 1, type: uint8}", ":7:32: .*cannot be 'uint8'"),
        ("ready:", "start:", "'start' is an input already"),
        ("heartbeat: {output: coil 0, input: discrete 0}", "unit: 1", "needs 'heartbeat'"),
        ("address: 127.0.0.86", "address: 127.0.0.86:0", "is not an address"),
        ("discrete 1", "discrete 99999", "an address from 0 to 65535"),
        ("output: coil 0", "output: coil 65536", "an address, 0 to 65535"),
        (
            "{at: discrete 1}",
            "{at: input 65535, type: float32}",
            "takes two registers, and input 65535 is the last",
        ),
        ("{at: discrete 1}", "{at: input 1, scale: 0}", "between 1e-06 and"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    with pytest.raises(CellFileError, match=words):
        settings(tmp_path, USUAL.replace(old, new))


def test_an_unreachable_plc_is_one_line_at_its_address(tmp_path: Path) -> None:
    line = refusal(tmp_path, USUAL)
    assert ":2:10:" in line
    assert "cannot be reached" in line
    assert "on port 502?" in line


def test_a_wrong_unit_is_one_line_at_the_unit(tmp_path: Path) -> None:
    line = refusal(tmp_path, USUAL + "unit: 7\n", PlcRig())
    assert ":8:7:" in line
    assert "as this unit" in line
    silent = PlcRig()
    silent.plc.inject_fault("silent")
    assert "does not answer as unit 7 within 200 ms" in refusal(
        tmp_path, USUAL + "unit: 7\n", silent
    )


@pytest.mark.parametrize(
    "banner", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-OpenSSH_9.2\r\n"]
)
def test_another_protocol_at_the_port_is_one_line_with_its_likely_causes(
    tmp_path: Path, banner: bytes
) -> None:
    rig = PlcRig()
    rig.plc.received = lambda peer, chunk: peer.send(banner)  # type: ignore[method-assign]
    line = refusal(tmp_path, USUAL, rig)
    assert ":2:10:" in line
    assert "is no Modbus frame" in line
    remedy = line[line.index("does another protocol answer on port 502?") :].splitlines()[0]
    assert "'unit'" in remedy
    assert len(remedy.split()) <= 25


@pytest.mark.realtime
def test_a_plc_is_reached_by_ipv6(tmp_path: Path) -> None:
    plc, done = PlcEmulator(), threading.Event()
    port = TcpPort(plc, "::1", clients=2)
    server = Server([port], [plc], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    try:
        said = settings(
            tmp_path, USUAL.replace("127.0.0.86", f"'{port.address}'") + "silence: 500 ms\n"
        )
        assert said.values.address[0] == "::1"
        signals = leaf.connect(said, ConnectContext(tmp_path / "plc.yaml", SystemClock(), 0))
        assert signals.link() == "ok"
        signals.close()
    finally:
        done.set()
        thread.join(5.0)


def test_what_the_plc_refuses_is_one_line_at_its_list(tmp_path: Path) -> None:
    rig = PlcRig(owned=[("coil", 1)])
    line = refusal(tmp_path, USUAL, rig)
    assert ":7:3:" in line
    assert "'ready' (coil 1) cannot be written" in line
    line = refusal(tmp_path, USUAL.replace("discrete 1", "discrete 500"), PlcRig())
    assert ":5:3:" in line
    assert "'start' (discrete 500) cannot be read" in line


def test_a_program_that_stands_still_is_one_line_at_the_heartbeat(tmp_path: Path) -> None:
    rig = PlcRig()
    rig.plc.inject_fault("stopped")
    assert "start its program" in refusal(tmp_path, USUAL, rig)


def test_the_names_are_known_before_the_connection(tmp_path: Path) -> None:
    text = USUAL.replace(
        "start: {at: discrete 1}", "mass: {at: input 10, type: float32, deadline: 1 s}"
    )
    said = settings(tmp_path, text).values
    assert list(said.known()) == [SignalNames(("mass",), ("ready",), frozenset({"mass"}))]
    assert said.places(said.inputs)["mass"].deadline == 1.0
    counted = settings(tmp_path, text.replace("float32", "int16, scale: 0.5")).values
    assert [names.counts for names in counted.known() if isinstance(names, SignalNames)] == [
        {"mass": (0.5, 32768.0)}
    ]
    assert said.wires == ("127.0.0.86:502",)


def test_the_driver_reads_and_writes_over_a_socket_and_another_process_makes_it_safe(
    tmp_path: Path,
) -> None:
    plc, done = PlcEmulator(), threading.Event()
    port = TcpPort(plc, clients=2)
    server = Server([port], [plc], time.monotonic)
    thread = threading.Thread(target=server.serve, args=(lambda: not done.is_set(),), daemon=True)
    thread.start()
    clock = SystemClock()
    try:
        text = USUAL.replace("127.0.0.86", f"'{port.address}'") + "silence: 500 ms\n"
        text = text.replace("discrete 0}", "discrete 0, deadline: 5 s}").replace(
            "discrete 1}", "discrete 1, deadline: 10 s}"
        )
        signals = leaf.connect(
            settings(tmp_path, text), ConnectContext(tmp_path / "plc.yaml", clock, 0)
        )
        signals.check()
        plc.memory["discrete"][1] = 1
        signals.write("ready", True)
        end = clock.now() + 20.0
        while not (plc.memory["coil"][1] and signals.read("start").value) and clock.now() < end:
            clock.advance(0.005)
            signals.check()
        assert (plc.memory["coil"][1], signals.read("start").value) == (1, True)
        signals.close()
        assert plc.memory["coil"][1] == 0
        plc.memory["coil"][1] = 1  # as a process leaves it that was killed
        assert signals.outside_stop is not None
        place, arguments = signals.outside_stop
        assert place == f"{client.__name__}:stop"
        client.stop(*arguments)
        assert plc.memory["coil"][1] == 0
    finally:
        done.set()
        thread.join(5.0)
