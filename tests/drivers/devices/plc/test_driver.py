"""The PLC's driver against the emulated PLC, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import struct

import pytest

from pomona.devices.plc.client import ModbusRefused
from pomona.devices.plc.codec import MemorySpan
from pomona.devices.plc.driver import RECONNECT, STALL, UnfitSignal
from pomona.devices.plc.places import SignalHeartbeat, SignalPlace
from pomona.drivers import DeviceFault, DeviceLost, MotionRefused, Nonsense
from tests.drivers.devices.plc.plc_rig import PlcRig


def test_inputs_are_read_and_outputs_are_written_in_each_cycle() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.plc.memory["discrete"][1] = 1
    rig.plc.memory["input"][4:6] = struct.unpack(">2H", struct.pack(">f", 2.5))
    signals.write("ready", True)
    signals.write("count", 12)
    rig.serve(signals, 0.1)
    assert (signals.read("start").value, signals.read("full").value) == (True, False)
    assert signals.read("mass").value == 2.5
    assert signals.read("start").age < 0.03
    assert (rig.plc.memory["coil"][1], rig.plc.memory["holding"][5]) == (1, 12)
    assert signals.read("ready").value is True
    assert signals.last_seen() == pytest.approx(rig.clock.now(), abs=0.03)
    assert signals.names.numbers == {"mass", "count"}


def test_the_connection_writes_the_safe_values() -> None:
    rig = PlcRig()
    rig.plc.memory["coil"][1] = 1
    rig.connected()
    assert (rig.plc.memory["coil"][1], rig.plc.memory["holding"][5]) == (0, 7)


def test_a_value_past_its_deadline_is_unknown_and_never_false() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.serve(signals, 0.1)
    assert signals.read("start").value is False
    rig.clock.advance(0.6)
    assert signals.read("start").value is None
    assert signals.read("start").age > 0.5


def test_a_lost_link_makes_every_value_unknown_and_ends_the_run() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.serve(signals, 0.1)
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    rig.pull_cable()
    rig.serve(signals, 0.05)
    assert signals.read("start").value is None
    with pytest.raises(DeviceLost, match="the cable is out"):
        signals.check()
    with pytest.raises(MotionRefused, match="stays at its safe value"):
        signals.write("ready", True)


def test_after_a_lost_link_the_outputs_are_safe_and_nothing_resumes_by_itself() -> None:
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    rig.pull_cable()
    rig.serve(signals, 0.1)
    assert rig.plc.memory["coil"][1] == 1  # the PLC sees the end of the heartbeat instead
    with pytest.raises(DeviceLost, match="still lost"):
        signals.acknowledge()
    rig.cut = False
    trail = watched(rig, "coil", 1)
    rig.serve(signals, 2.0 * RECONNECT)
    back = trail.index(0)  # with the connection
    with pytest.raises(MotionRefused):
        signals.write("ready", True)
    signals.acknowledge()
    rig.serve(signals, 0.5)
    signals.check()
    assert trail[-1] == 0
    assert not any(trail[back:])
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    assert rig.plc.memory["coil"][1] == 1


def watched(rig: PlcRig, area: str, address: int) -> list[int]:
    """Return a place's value in each scan of the PLC from now on."""
    values: list[int] = []
    rig.plc.program = lambda _now: values.append(rig.plc.memory[area][address])
    return values


def test_a_silent_plc_is_lost() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.plc.inject_fault("silent")
    rig.serve(signals, 0.3)
    with pytest.raises(DeviceLost, match="does not answer as unit 1 within 200 ms"):
        signals.check()


def test_bytes_that_are_no_modbus_are_nonsense() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.plc.inject_fault("garbage")
    rig.serve(signals, 0.1)
    with pytest.raises(Nonsense, match="no Modbus frame"):
        signals.check()


def test_a_busy_plc_is_a_fault() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.plc.inject_fault("busy")
    rig.serve(signals, 0.1)
    with pytest.raises(DeviceFault, match="it is busy"):
        signals.check()


def test_a_program_that_stops_is_noticed_by_its_heartbeat_although_modbus_answers() -> None:
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    rig.serve(signals, 1.0)
    signals.check()
    rig.plc.inject_fault("stopped")
    rig.serve(signals, 0.7)
    with pytest.raises(
        DeviceFault, match=r"its heartbeat \(discrete 0\) stands still for .* ms: its program"
    ):
        signals.check()
    assert rig.plc.memory["coil"][1] == 0
    with pytest.raises(DeviceFault, match="stands still"):
        signals.acknowledge()
    rig.plc.clear_fault()
    rig.serve(signals, 0.3)
    signals.acknowledge()
    rig.serve(signals, 0.3)
    signals.check()


def test_our_heartbeat_toggles_while_the_run_ticks() -> None:
    rig = PlcRig()
    signals = rig.connected()
    rig.serve(signals, 1.0)
    assert rig.plc.alive
    signals.close()
    rig.clock.advance(1.0)
    assert not rig.plc.alive


def test_a_run_that_stands_still_stops_our_heartbeat_and_its_outputs_go_to_their_safe_values() -> (
    None
):
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    rig.serve(signals, 0.2)
    trail = watched(rig, "coil", 1)
    rig.serve(signals, STALL + 0.2, ticks=False)
    assert rig.plc.memory["coil"][1] == 0
    rig.serve(signals, 1.0, ticks=False)
    assert not rig.plc.alive
    with pytest.raises(DeviceFault, match="stood still for 1 s"):
        signals.check()
    rig.serve(signals, 0.5)  # it goes on, and its outputs stay
    assert not any(trail[trail.index(0) :])


def test_a_safe_stop_writes_the_safe_values_until_it_is_acknowledged() -> None:
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    signals.write("count", 3)
    rig.serve(signals, 0.1)
    signals.safe_stop("the operator")
    assert not signals.settled()
    rig.serve(signals, 0.1)
    assert signals.settled()
    assert (rig.plc.memory["coil"][1], rig.plc.memory["holding"][5]) == (0, 7)
    ready = watched(rig, "coil", 1)
    with pytest.raises(MotionRefused, match="the operator"):
        signals.write("ready", True)
    rig.serve(signals, 0.5)
    signals.acknowledge()
    rig.serve(signals, 0.5)
    assert ready.count(0) == len(ready) > 0
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    assert rig.plc.memory["coil"][1] == 1


def test_the_end_of_the_run_writes_the_safe_values() -> None:
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    signals.close()
    assert rig.plc.memory["coil"][1] == 0
    assert signals.read("start").value is None


def test_another_process_writes_the_safe_values_with_the_same_requests() -> None:
    rig = PlcRig()
    signals = rig.connected()
    signals.write("ready", True)
    rig.serve(signals, 0.1)
    client = rig.client()
    for area, first, values in signals.safe_writes:
        client.write(area, first, values)
    assert (rig.plc.memory["coil"][1], rig.plc.memory["coil"][2], rig.plc.memory["holding"][5]) == (
        0,
        0,
        7,
    )


@pytest.mark.parametrize(("value", "words"), [(2.0, "no value of a switch"), (True, "")])
def test_a_value_that_does_not_fit_is_refused(value: float, words: str) -> None:
    rig = PlcRig()
    signals = rig.connected()
    if words:
        with pytest.raises(MotionRefused, match=words):
            signals.write("ready", value)
    with pytest.raises(MotionRefused, match="does not fit into uint16"):
        signals.write("count", 70000)
    with pytest.raises(KeyError):
        signals.write("start", True)
    with pytest.raises(KeyError):
        signals.read("nothing")


def test_a_signal_out_of_the_plcs_range_is_named_before_anything_is_written() -> None:
    rig = PlcRig()
    signals = rig.signals(inputs={"start": SignalPlace("discrete 900")})
    rig.plc.memory["coil"][1] = 1
    with pytest.raises(
        UnfitSignal, match=r"'start' \(discrete 900\) cannot be read: .*no such address"
    ) as raised:
        signals.connect()
    assert raised.value.key == "inputs"
    assert rig.plc.memory["coil"][1] == 1


def test_a_register_that_a_field_bus_owns_is_named() -> None:
    rig = PlcRig(owned=[("holding", 5)])
    with pytest.raises(
        UnfitSignal, match=r"'count' \(holding 5\) cannot be written: .*does a field bus"
    ) as raised:
        rig.signals().connect()
    assert raised.value.key == "outputs"


def test_a_register_that_drops_what_is_written_is_named() -> None:
    rig = PlcRig(owned=[("holding", 5)])
    rig.plc.inject_fault("overwriting")
    with pytest.raises(
        UnfitSignal, match=r"'count' .*does not keep the value 7: .*field bus writes there"
    ):
        rig.signals().connect()


def test_a_register_that_the_plcs_program_overwrites_is_named() -> None:
    rig = PlcRig()
    rig.plc.program = lambda now: rig.plc.memory["coil"].__setitem__(2, 1)
    with pytest.raises(UnfitSignal, match=r"'done' .*does not keep the value 0"):
        rig.signals().connect()


def test_a_heartbeat_that_stands_still_is_refused_before_the_run() -> None:
    rig = PlcRig()
    rig.plc.inject_fault("stopped")
    with pytest.raises(
        DeviceFault, match=r"its heartbeat \(discrete 0\) stands still for .* ms: start its"
    ):
        rig.signals().connect()


def test_a_heartbeat_at_a_wrong_address_is_named() -> None:
    beats = SignalHeartbeat(output="coil 0", input="input 999")
    with pytest.raises(UnfitSignal, match=r"heartbeat.* cannot be read") as raised:
        PlcRig().signals(beats=beats).connect()
    assert raised.value.key == "heartbeat"


def test_a_wrong_unit_is_lost_or_refused() -> None:
    rig = PlcRig()
    with pytest.raises(ModbusRefused, match="nothing answers behind its gateway"):
        rig.signals(unit=7).connect()
    rig.plc.inject_fault("silent")
    with pytest.raises(DeviceLost, match="does not answer as unit 7"):
        rig.signals(unit=7).connect()


def test_an_answer_to_an_earlier_request_is_dropped() -> None:
    rig = PlcRig()
    client = rig.client()
    rig.plc.inject_fault("silent")
    with pytest.raises(DeviceLost):
        client.read(MemorySpan("coil", 0, 1))
    rig.plc.clear_fault()
    rig.plc.memory["coil"][3] = 1
    rig.wires[-1].arrived += bytes.fromhex(
        "00 01 00 00 00 04 01 01 01 00"
    )  # the late answer to the first
    assert client.read(MemorySpan("coil", 3, 1)) == (1,)


def test_a_request_longer_than_modbus_allows_is_a_mistake_of_the_caller() -> None:
    client = PlcRig().client()
    with pytest.raises(ValueError, match="1 to 125"):
        client.read(MemorySpan("holding", 0, 126))
    with pytest.raises(ValueError, match="1 to 123"):
        client.write("holding", 0, [0] * 124)
