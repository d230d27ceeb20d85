"""A Universal Robots controller that speaks its bytes: RTDE, dashboard, and scripts, which it executes."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pomona.devices.emulators.emulated import (
    EmulatedArm,
    EmulatedDevice,
    EmulatedWire,
    EmulatorKind,
    Joints,
    OwnTime,
    SimJoints,
    world_of,
)
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import ControllerPort
from pomona.devices.laboratory_emulators.urscript import compile_script
from pomona.drivers import Arm, Cell, LoadSensor
from pomona.executive import Float64

CYCLE = 0.002
"""Control cycle of an e-series [s]."""
MOST = 40.0
"""Acceleration of a joint under servoj and in a stop [rad/s²]: plausible, not measured."""
DEVIATES = 0.1
"""Distance of a joint from its set-point that is a protective stop [rad]: plausible, not measured."""
LOCKED = 5.0
"""Time for which a protective stop cannot be unlocked [s] (PolyScope's dashboard server)."""
POWERING = 0.2
"""Time of each of power and brakes [s]; a real arm takes some seconds."""
WAIT = "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of protective stop before unlocking"
_NUMBERS = """timestamp speed_scaling target_speed_fraction speed_slider_fraction actual_momentum actual_main_voltage
actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 standard_analog_output0
standard_analog_output1 tool_analog_input0 tcp_force_scalar payload actual_execution_time standard_analog_output_0
standard_analog_output_1"""
_SIXES = """actual_q actual_qd target_q target_qd target_qdd target_current target_moment actual_current
actual_current_as_torque actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed
joint_control_output joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia external_force_torque"""
_BITS = "runtime_state robot_status_bits safety_status_bits speed_slider_mask"
TYPES: dict[str, str] = {
    **dict.fromkeys(("robot_mode", "safety_mode"), "INT32"),
    **dict.fromkeys(_BITS.split(), "UINT32"),
    **dict.fromkeys(("actual_digital_input_bits", "actual_digital_output_bits"), "UINT64"),
    **dict.fromkeys(_NUMBERS.split(), "DOUBLE"),
    **dict.fromkeys(_SIXES.split(), "VECTOR6D"),
    "joint_mode": "VECTOR6INT32",
    **dict.fromkeys(("actual_tool_accelerometer", "payload_cog", "target_gravity"), "VECTOR3D"),
}
"""Types of RTDE's fields."""
LAYOUTS = {
    "DOUBLE": "d",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "BOOL": "?",
    "UINT8": "B",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR3D": "3d",
}
PORTS = {"rtde": 30004, "script": 30002, "dashboard": 29999}
_INERT = """zero_ftsensor set_payload set_tcp teach_mode end_teach_mode force_mode end_force_mode force_mode_set_damping
force_mode_set_gain_scaling set_gravity set_target_payload get_target_payload get_target_payload_cog freedrive_mode
end_freedrive_mode get_tcp_offset get_forward_kin get_inverse_kin get_joint_torques tool_contact pose_trans pose_inv
pose_sub pose_add reset_world_model get_target_tcp_speed write_output_boolean_register read_input_boolean_register
ft_rtde_input_enable enable_external_ft_sensor get_freedrive_status direct_torque get_mass_matrix get_jacobian textmsg
popup"""
"""Functions of a script that move nothing here."""


class UrEmulator(EmulatedArm):
    """The controller; `rtde`, `dashboard` and `script` serve its three ports.

    Faults: `protective`, `e_stop`, `safeguard`, `reduced`, `freedrive` (states of the safety system and the arm);
    `slider` (the speed slider at a half), `paused`, `no_script` (at the pendant), `replaced` (another program);
    `killed` (all connections end), `silent` (no byte at any port), `slow` (a package every 0.1 s); those of its joints;
    `other_model`, `old`, `local`, `owned` (before a connection: a UR10, PolyScope 3.11, local control, a register of a
    field bus).

    Attributes:
        model, version, remote: what the dashboard answers; the version also RTDE.
        mode, safety, runtime, slider: as RTDE reports them.
        cycle: of its control [s]: 2 ms, 8 ms of a CB3. clock: its own time.
        scaling: share of its speed to which it slows its motions down by itself; they take longer.
        bus: input fields that a field bus owns.
        program: name of the running program, or None.
        tcp_force, tcp_pose: at the tool, (6,) [N, N·m], and of the tool, with a rotation vector, (6,) [m, rad].
    """

    known_faults = (
        *EmulatedArm.known_faults,
        "protective",
        "e_stop",
        "safeguard",
        "reduced",
        "freedrive",
        "slider",
        "paused",
        "no_script",
        "replaced",
        "killed",
        "silent",
        "slow",
        "other_model",
        "old",
        "local",
        "owned",
    )

    def __init__(self, joints: Joints, velocity: Float64, model: str = "UR5") -> None:
        super().__init__(joints)
        self.rtde, self.dashboard, self.script = (
            _RtdePort(self),
            _DashboardPort(self),
            _ScriptPort(self),
        )
        self.model = model
        self.version = (5, 23, 0, 0)
        self.remote = True
        self.safety = 1
        self.mode = 7
        self.runtime = 1
        self.slider = 1.0
        self.status = 1
        self.cycle, self.scaling, self.clock = CYCLE, 1.0, OwnTime()
        self._owed = 0.0  # time of servoj that has not been served yet [s]
        self.inputs: dict[str, float] = {}
        self.out_int = [0] * 48
        self.out_float = [0.0] * 48
        self.bus: set[str] = set()
        self.program: str | None = None
        self.tcp_pose = [0.0] * 6
        self.tcp_force: Callable[[], Sequence[float]] = lambda: [0.0] * 6
        self.now = 0.0
        self._stopped_at = -math.inf
        self._next: float | None = None
        self._mode_due: list[tuple[float, int]] = []
        self._written_at: dict[str, float] = {}
        self._watch: tuple[str, float] | None = None
        self._threads: list[Iterator[None]] = []
        self._velocity = velocity
        self._moved = False

    # ------------------------------------------------------------------------------------------ faults

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind in ("protective", "safeguard", "e_stop"):
            self._stop_safely({"protective": 3, "safeguard": 5, "e_stop": 7}[kind])
        elif kind == "reduced":
            self.safety = 2
        elif kind == "freedrive":
            self.status |= 4
        elif kind == "slider":
            self.slider = 0.5
        elif kind == "paused" and self.program:
            self.runtime = 4
        elif kind == "no_script":
            self.end_program()
        elif kind == "replaced":
            self.load("def other():\n  while True:\n    sync()\n  end\nend\n")
        elif kind == "killed":
            for port in (self.rtde, self.dashboard, self.script):
                port.hang_up()
        elif kind == "other_model":
            self.model = "UR10"
        elif kind == "old":
            self.version = (3, 11, 0, 0)
        elif kind == "local":
            self.remote = False
        elif kind == "owned":
            self.bus.add("input_int_register_24")

    def clear_fault(self) -> None:
        """Release the button, close the guard, plug the cable in; a protective stop is unlocked by a command."""
        kind = self.fault
        super().clear_fault()
        self.slider = 1.0
        self.status = 1
        if self.safety in (2, 5):
            self.safety = 1
        elif self.safety == 7:
            # the arm has no power after it
            self.safety = 1
            self.mode = 3
        if kind == "paused" and self.program:
            self.runtime = 2

    @property
    def deaf(self) -> bool:
        """Whether nothing passes at any port."""
        return self.fault in ("silent", "killed")

    def _stop_safely(self, safety: int) -> None:
        self.safety, self._stopped_at = safety, self.now
        if safety == 7:
            self.mode = 3
        self.end_program()
        self._halt()

    def unlock(self) -> str:
        """Release a protective stop; return the dashboard's answer."""
        if self.safety == 3 and self.now - self._stopped_at < LOCKED:
            return WAIT
        self.safety = 1 if self.safety == 3 else self.safety
        return "Protective stop releasing"

    def power(self, mode: int) -> None:
        """Power on (to mode 5), or release the brakes (to mode 7), which takes a moment."""
        if self.mode < mode and self.safety == 1:
            self._mode_due.append((self.now + POWERING, mode))

    def end_program(self) -> None:
        """Stop the program; a moving arm brakes."""
        self.program = None
        self._watch = None
        self.runtime = 1
        self._threads.clear()

    # -------------------------------------------------------------------------------------------- time

    def advance(self, now: float) -> None:
        """Make the cycles until now."""
        now = self.clock.at(now)
        self._next = now if self._next is None or now - self._next > 1.0 else self._next
        while self._next <= now + 1e-9:
            self.now = self._next
            self._next += self.cycle
            self._cycle()

    def _cycle(self) -> None:
        """Run the program's threads, drive the joints, push the state."""
        self._moved = False
        for due, mode in tuple(self._mode_due):
            if self.now >= due:
                self.mode = max(self.mode, mode)
                self._mode_due.remove((due, mode))
        if (
            self._watch is not None
            and self.now - self._written_at.get(self._watch[0], self.now) > self._watch[1]
        ):
            self.end_program()
        for thread in tuple(self._threads) if self.runtime == 2 else ():
            if thread in self._threads and self._is_over(thread):
                self._threads.remove(thread)
                if not self._threads or thread is self._main:
                    self.end_program()
        if not self._moved:
            self._brake(MOST)
        self._drive(self._q, self._qd)
        if self.fault != "stuck" and np.abs(self._joints.measured()[0] - self._q).max() > DEVIATES:
            self._stop_safely(3)
        self.rtde.push()

    def _is_over(self, thread: Iterator[None]) -> bool:
        """Run a thread of the program for a cycle; an error in it stops the program, as on a pendant."""
        try:
            return next(thread, thread) is thread
        except Exception:
            self.end_program()
            return False

    def _go(self, wanted: Float64, acceleration: float) -> None:
        most = acceleration * self.cycle
        self._qd = self._qd + np.minimum(np.maximum(wanted - self._qd, -most), most)
        self._q = self._q + self._qd * self.cycle
        self._moved = True

    def _brake(self, acceleration: float) -> None:
        """Stop linearly in joint space: the quickest joint brakes with this [rad/s²]."""
        quickest = float(np.abs(self._qd).max())
        left = max(1.0 - acceleration * self.cycle / quickest, 0.0) if quickest > 0.0 else 0.0
        self._qd = self._qd * left
        self._q = self._q + self._qd * self.cycle
        self._moved = True

    # ------------------------------------------------------------------------------------------ scripts

    def load(self, text: str) -> None:
        """Replace the program, where the robot may move and takes programs from outside."""
        if self.safety in (1, 2) and self.mode == 7 and self.remote:
            self.end_program()
            self._halt()
            try:
                self.program, space = compile_script(text, self._functions())
            except SyntaxError:
                return
            self._main: Iterator[None] = space["__main"]()
            self._threads.append(self._main)
            self.runtime = 2

    def servo(self, q: Float64, lookahead: float) -> None:
        """Follow a set-point with a lag, as servoj does; one that is too quick is a protective stop."""
        wanted = (q - self._q) / max(lookahead, 0.03)
        if np.any(np.abs(wanted) > 2.0 * self._velocity):
            self._stop_safely(3)
        else:
            most = 1.2 * self._velocity
            self._go(np.minimum(np.maximum(wanted, -most), most), 2.0 * MOST)

    def _functions(self) -> dict[str, Any]:
        """Return the functions of a script; those that take time are generators."""
        return {
            **dict.fromkeys(_INERT.split(), lambda *_a, **_k: 0),
            **self._motions(),
            **self._registers(),
        }

    def _motions(self) -> dict[str, Any]:
        def servoj(  # type: ignore[no-untyped-def]
            q: Any,
            a: float = 0,
            v: float = 0,
            t: float = 0.0,
            lookahead_time: float = 0.1,
            gain: float = 0,
        ):
            self._owed += max(t, self.cycle)
            while self._owed > 1e-9:
                self.servo(_six(q), lookahead_time)
                self._owed -= self.cycle * self.scaling
                yield

        def movej(q: Any, a: float = 1.4, v: float = 1.05, *_rest: float, **_more: float):  # type: ignore[no-untyped-def]
            start = self._q.copy()
            end = _six(q)
            way = float(np.abs(end - start).max())
            rise = min(v / a, math.sqrt(way / a))
            whole = 2.0 * rise + max(way - a * rise**2, 0.0) / v
            for i in range(1, math.ceil(whole / self.cycle) + 1 if way > 1e-9 else 0):
                t = min(i * self.cycle, whole)
                up = min(t, rise)
                down = max(t - (whole - rise), 0.0)
                done = (
                    a * (rise * t - 0.5 * rise**2 - 0.5 * down**2) if t > rise else 0.5 * a * up**2
                )
                q_next = start + (end - start) * (done / way)
                self._qd = (q_next - self._q) / self.cycle
                self._q = q_next
                self._moved = True
                yield
            self._qd = np.zeros_like(self._qd)

        def speedj(qd: Any, a: float = 1.4, t: float = 0.0):  # type: ignore[no-untyped-def]
            for _ in range(max(round(t / self.cycle), 1)):
                self._go(_six(qd), a)
                yield

        def stopj(a: float = 2.0, *_rest: float):  # type: ignore[no-untyped-def]
            while np.abs(self._qd).max() > 0.0:
                self._brake(abs(a) or 2.0)
                yield

        def sleep(t: float):  # type: ignore[no-untyped-def]
            yield from (None for _ in range(max(round(t / self.cycle), 1)))

        def sync():  # type: ignore[no-untyped-def]
            yield

        moves = dict.fromkeys(("movej", "movel"), movej) | dict.fromkeys(
            ("speedj", "speedl"), speedj
        )
        stops = dict.fromkeys(("stopj", "stopl"), stopj)
        return {**moves, **stops, "servoj": servoj, "servoc": servoj, "sleep": sleep, "sync": sync}

    def _registers(self) -> dict[str, Any]:
        def watch(name: str, rate: float, action: str = "pause") -> None:
            self._watch = (name, 1.0 / rate)
            self._written_at[name] = self.now

        def run(function: Callable[[], Iterator[None]]) -> Iterator[None]:
            thread = function()
            self._threads.append(thread)
            return thread

        def kill(thread: Iterator[None]) -> None:
            if thread in self._threads:
                self._threads.remove(thread)

        return {
            "rtde_set_watchdog": watch,
            "run": run,
            "kill": kill,
            "halt": self.end_program,
            "norm": lambda v: math.hypot(*v) if isinstance(v, list) else abs(v),
            "length": len,
            "pose": list,
            **{name: getattr(math, name) for name in ("sqrt", "ceil", "floor")},
            "d2r": math.radians,
            "get_steptime": lambda: self.cycle,
            "is_steady": lambda: bool(np.abs(self._qd).max() < 1e-6),
            "get_actual_joint_positions": lambda: self._q.tolist(),
            "get_target_joint_positions": lambda: self._q.tolist(),
            "get_actual_joint_speeds": lambda: self._qd.tolist(),
            "get_actual_tcp_pose": lambda: [0.0] * 6,
            "get_target_tcp_pose": lambda: [0.0] * 6,
            "protective_stop": lambda: self._stop_safely(3),
            "read_input_integer_register": lambda i: int(
                self.inputs.get(f"input_int_register_{i}", 0)
            ),
            "read_input_float_register": lambda i: self.inputs.get(
                f"input_double_register_{i}", 0.0
            ),
            "write_output_integer_register": lambda i, value: self.out_int.__setitem__(
                i, int(value)
            ),
            "write_output_float_register": lambda i, value: self.out_float.__setitem__(
                i, float(value)
            ),
        }

    # --------------------------------------------------------------------------------------- variables

    def store(self, name: str, number: float) -> None:
        """Set an input field."""
        self.inputs[name] = number
        self._written_at[name] = self.now

    def reader(self, name: str) -> Callable[[], Any]:
        """Return what reads an output field; zero where the emulator has none."""
        register = re.fullmatch(r"output_(int|double)_register_(\d+)", name)
        if register:
            registers: list[Any] = self.out_int if register[1] == "int" else self.out_float
            number = int(register[2])
            return lambda: registers[number]
        size = {"VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR3D": 3}.get(TYPES[name], 0)
        safety = {1: 0, 2: 1, 3: 2, 5: 4, 7: 6}
        known: Mapping[str, Callable[[], Any]] = {
            "actual_q": lambda: self.measured()[0].tolist(),
            "actual_qd": lambda: self.measured()[1].tolist(),
            "timestamp": lambda: self.now,
            "target_q": lambda: self._q.tolist(),
            "target_qd": lambda: self._qd.tolist(),
            "robot_mode": lambda: self.mode,
            "safety_mode": lambda: self.safety,
            "runtime_state": lambda: self.runtime,
            "robot_status_bits": lambda: self.status | (2 if self.program else 0),
            "safety_status_bits": lambda: 1 << safety.get(self.safety, 9),
            "speed_scaling": lambda: self.slider * self.scaling,
            "target_speed_fraction": lambda: self.slider,
            "joint_mode": lambda: [253] * 6,
            "actual_TCP_force": lambda: self.tcp_force(),
            "actual_TCP_pose": lambda: self.tcp_pose,
        }
        return known.get(name, lambda: [0] * size if size else 0)


def _six(numbers: Any) -> Float64:
    """Return a number of each joint. Raises ValueError: they are others."""
    found = np.array(numbers, dtype=np.float64)
    if found.shape != (6,) or not np.isfinite(found).all():
        raise ValueError("six joints are needed")
    return found


def _kind(name: str, direction: str) -> str | None:
    """Return the type of a field, or None where there is none."""
    register = re.fullmatch(rf"{direction}_(int|double|bit)_register_(\d+)", name)
    if register:
        most = 128 if register[1] == "bit" else 48
        kind = {"int": "INT32", "double": "DOUBLE", "bit": "BOOL"}[register[1]]
        return kind if int(register[2]) < most else None
    if (
        direction == "input"
        and re.fullmatch(r".*_(mask|output|type)|.*_bits\w*", name)
        and name not in TYPES
    ):
        return "UINT8"
    return TYPES.get(name)


class _DashboardPort(ControllerPort):
    def connected(self, peer: Peer) -> None:
        super().connected(peer)
        if not self._robot.deaf:
            peer.send(b"Connected: Universal Robots Dashboard Server\n")

    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        while b"\n" in buffer:
            end = buffer.index(b"\n")
            line = bytes(buffer[:end]).decode("ascii", "replace").strip()
            del buffer[: end + 1]
            peer.send(self._answer(line).encode() + b"\n")

    def _answer(self, line: str) -> str:
        robot = self._robot
        mode = {3: "POWER_OFF", 5: "IDLE", 7: "RUNNING"}.get(robot.mode, "BOOTING")
        safety = {1: "NORMAL", 2: "REDUCED", 3: "PROTECTIVE_STOP", 5: "SAFEGUARD_STOP"}.get(
            robot.safety, "FAULT"
        )
        told: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: (
                f"URSoftware {'.'.join(map(str, robot.version))} (Jan 01 2026)"
            ),
            "get robot model": lambda: robot.model,
            "get serial number": lambda: "20225500001",
            "is in remote control": lambda: "true" if robot.remote else "false",
            "robotmode": lambda: f"Robotmode: {mode}",
            "safetystatus": lambda: f"Safetystatus: {safety}",
            "safetymode": lambda: f"Safetymode: {safety}",
            "programstate": lambda: f"{'PLAYING' if robot.program else 'STOPPED'} none.urp",
            "running": lambda: f"Program running: {'true' if robot.program else 'false'}",
            "unlock protective stop": robot.unlock,
            "close popup": lambda: "closing popup",
            "close safety popup": lambda: "closing safety popup",
            "quit": lambda: "Disconnected",
        }
        orders: dict[str, tuple[Callable[[], None], str]] = {
            "power on": (lambda: robot.power(5), "Powering on"),
            "brake release": (lambda: robot.power(7), "Brake releasing"),
            "stop": (robot.end_program, "Stopped"),
        }
        if line.lower() in orders:
            order, answer = orders[line.lower()]
            order()
            return answer
        return told.get(line.lower(), lambda: f'could not understand: "{line}"')()


class _ScriptPort(ControllerPort):
    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        text = buffer.decode("utf-8", "replace")
        opened = len(re.findall(r"(?m)^\s*(?:def|thread|if|while)\b", text))
        if (
            text.rstrip().endswith("end")
            and len(re.findall(r"(?m)^\s*end\s*(?:#.*)?$", text)) >= opened
        ):
            buffer.clear()
            self._robot.load(text)


class _Client:
    """The recipes of one RTDE client."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.started = False
        self.every = 1
        self.outputs: list[Callable[[], Any]] = []
        self.layout = struct.Struct(">B")
        self.inputs: dict[int, tuple[list[str], struct.Struct]] = {}

    def say(self, kind: bytes, body: bytes) -> None:
        """Send a message: its size, its kind, its body (RTDE guide of Universal Robots)."""
        self.peer.send(struct.pack(">H", 3 + len(body)) + kind + body)


class _RtdePort(ControllerPort):
    def __init__(self, controller: UrEmulator) -> None:
        super().__init__(controller)
        self._clients: dict[int, _Client] = {}
        self._count = 0

    def connected(self, peer: Peer) -> None:
        super().connected(peer)
        self._clients[id(peer)] = _Client(peer)

    def disconnected(self, peer: Peer) -> None:
        super().disconnected(peer)
        self._clients.pop(id(peer), None)

    def push(self) -> None:
        """Send the fields to each client, every so many cycles."""
        self._count += 1
        if self._robot.deaf or (self._robot.fault == "slow" and self._count % 50):
            return
        for client in tuple(self._clients.values()):
            if client.started and (self._count % client.every == 0 or self._robot.fault == "slow"):
                values: list[Any] = []
                for read in client.outputs:
                    found = read()
                    values += found if isinstance(found, list) else [found]
                client.say(b"U", client.layout.pack(1, *values))

    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        try:
            while len(buffer) >= 3:
                (size,) = struct.unpack_from(">H", buffer)
                if len(buffer) < size:
                    return
                message = bytes(buffer[2 : max(size, 3)])
                del buffer[: max(size, 3)]
                self._message(self._clients[id(peer)], message[:1], message[1:])
        except (struct.error, KeyError, ValueError):
            peer.close()

    def _message(self, client: _Client, kind: bytes, body: bytes) -> None:
        match kind:
            case b"V":  # version of the protocol
                modern = self._robot.version[:2] >= (3, 2) and body in (b"\x00\x01", b"\x00\x02")
                client.say(kind, b"\x01" if modern else b"\x00")
            case b"v":
                client.say(kind, struct.pack(">4I", *self._robot.version))
            case b"S" | b"P":
                client.started = kind == b"S"
                client.say(kind, b"\x01")
            case b"O":
                self._subscribe(client, body)
            case b"I":
                self._take_recipe(client, [name for name in body.decode().split(",") if name])
            case b"U":
                names, layout = client.inputs[body[0]]
                for name, number in zip(names, layout.unpack(body[1:])[: len(names)], strict=False):
                    self._robot.store(name, number)
            case _:
                raise ValueError("no kind of RTDE")

    def _subscribe(self, client: _Client, body: bytes) -> None:
        names = [name for name in body[8:].decode().split(",") if name]
        kinds = [_kind(name, "output") for name in names]
        client.every = max(round(1.0 / self._robot.cycle / struct.unpack_from(">d", body)[0]), 1)
        known = [name for name, kind in zip(names, kinds, strict=True) if kind]
        client.outputs = [self._robot.reader(name) for name in known]
        client.layout = struct.Struct(">B" + "".join(LAYOUTS[kind] for kind in kinds if kind))
        client.say(b"O", b"\x01" + ",".join(kind or "NOT_FOUND" for kind in kinds).encode())

    def _take_recipe(self, client: _Client, names: list[str]) -> None:
        others = (other for other in self._clients.values() if other is not client)
        owned = self._robot.bus.union(
            *(names for other in others for names, _ in other.inputs.values())
        )
        kinds = [
            "IN_USE" if name in owned else _kind(name, "input") or "NOT_FOUND" for name in names
        ]
        number = 0
        if all(kind in LAYOUTS for kind in kinds):
            number = len(client.inputs) + 1
            client.inputs[number] = (
                names,
                struct.Struct(">" + "".join(LAYOUTS[kind] for kind in kinds)),
            )
        client.say(b"I", bytes([number]) + ",".join(kinds).encode())


def _addresses(address: str) -> tuple[str, ...]:
    return tuple(f"{address}:{port}" for port in PORTS.values())


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    controller = UrEmulator(SimJoints(world_of(cell)), cell.device(Arm).limits.velocity)
    if LoadSensor in cell.interfaces():
        sensor = cell.device(LoadSensor)
        controller.tcp_force = lambda: (
            [0.0] * 6 if (s := sensor.latest()) is None else s.wrenches[0].tolist()
        )
    wires = (
        EmulatedWire(f"{name}_wire", address, getattr(controller, name), clients=4)
        for name, address in zip(PORTS, addresses, strict=True)
    )
    return EmulatedDevice(tuple(wires), controller.advance, {"": controller})


UNIVERSAL_ROBOTS = EmulatorKind(_addresses, _make)
