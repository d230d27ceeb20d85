"""When the executive hangs or is killed, its supervisor stops emulated devices in another process, over their wires."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.cell.connect import load_cell

pytestmark = pytest.mark.slow

ROBOT = Path(__file__).parents[2] / "trees" / "robots" / "sia5f_wsg32.xml"
CELL = """
name: bench
kind: emulated
heartbeat: 4 s
devices:
  arm: {{driver: motoman, address: "127.0.0.1:{arm}", controller: fs100, robot: {robot}, silence: 1 s, lead: 600 ms,
        supervision: {{status: 2 s, stall: 5 s, lag: 1 s, following_error: 0.5 rad}}}}
  gripper: {{driver: wsg, tcp: "127.0.0.1:{gripper}", silence: 1 s}}
"""
RUN = """
import sys, time
from benchmarks.kill_points_skills import _quintic
from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.cli import main
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work


class Move(Skill):
    devices = (Gripper,) if sys.argv[1] == "launched" else (Arm, Gripper)

    def run(self) -> Work[None]:
        gripper = self.device(Gripper)
        if Arm in self.devices:
            arm = self.device(Arm)
            arm.follow(_quintic(arm.state().q, 1.0, 20.0))
        gripper.move(gripper.limits.width_min + 0.002, 0.002)
        yield from self.wait(1.0)
        print("moving", flush=True)
        if sys.argv[1] == "hang":
            while True:
                time.sleep(1.0)
        yield from self.wait(60.0)

Registry.installed = classmethod(lambda cls: Registry({"Move": Move}))
way = sys.argv[1]
del sys.argv[0 if way == "launched" else slice(0, 0)]
sys.exit(main() if way == "launched" else main(sys.argv[2:]))
"""


@dataclass(frozen=True)
class Place:
    cell: Path
    tree: Path
    records: Path


def free_ports(count: int) -> int:
    """The first of so many free ports in a row."""
    while True:
        with contextlib.ExitStack() as stack, contextlib.suppress(OSError):
            first = stack.enter_context(socket.create_server(("127.0.0.1", 0))).getsockname()[1]
            for port in range(first + 1, first + count):
                stack.enter_context(socket.create_server(("127.0.0.1", port)))
            return int(first)


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    arm, gripper = free_ports(3), free_ports(1)
    orders = [["motoman", "--port", str(arm)], ["wsg", "--tcp", f"127.0.0.1:{gripper}"]]
    with contextlib.ExitStack() as stack:
        for order in orders:
            command = [sys.executable, "-m", "pomona.devices.emulators.command_emulate", *order]
            process = stack.enter_context(
                subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            )
            stack.callback(process.terminate)
            assert process.stdout is not None
            process.stdout.readline()
        cell, tree = tmp_path / "bench.yaml", tmp_path / "move.yaml"
        cell.write_text(CELL.format(arm=arm, gripper=gripper, robot=ROBOT))
        tree.write_text("pomona: 1\ntree: move\nroot: {Move: {}}\n")
        yield Place(cell, tree, tmp_path / "runs")


@pytest.fixture
def gripper_place(place: Place) -> Place:
    """The same without the arm, whose points run out on a busy computer. Its runs have a launcher."""
    lines = place.cell.read_text().splitlines()
    place.cell.write_text(
        "\n".join(line for line in lines if "arm" not in line and "supervision" not in line)
    )
    return place


@contextlib.contextmanager
def moving(place: Place, way: str) -> Iterator[subprocess.Popen[str]]:
    """A run whose arm and fingers move."""
    order = [
        "run",
        str(place.tree),
        "--cell",
        str(place.cell),
        "--record",
        str(place.records),
        "--cleared",
    ]
    with subprocess.Popen(
        [sys.executable, "-c", RUN, way, *order],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        received = []
        for line in process.stdout:
            received.append(line)
            if line == "moving\n":
                break
        assert received[-1:] == ["moving\n"], "".join(received) + process.stderr.read()
        yield process


def fingers_stand(place: Place) -> None:
    """Check that the fingers rest before their goal; a new connection has the gripper to itself."""
    with contextlib.closing(load_cell(place.cell)) as cell:
        gripper = cell.device(Gripper)
        before = gripper.state().width
        time.sleep(0.3)
        assert gripper.state().width == pytest.approx(before, abs=1e-6)
        assert gripper.limits.width_min + 0.004 < before, "the fingers went on to their goal"


def is_at_rest(place: Place) -> tuple[float, float]:
    """Last joint and opening of devices that must stand; a new connection has the devices to itself."""
    with contextlib.closing(load_cell(place.cell)) as cell:
        arm, gripper = cell.device(Arm), cell.device(Gripper)
        before = arm.state().q[-1], gripper.state().width
        time.sleep(0.3)
        assert (arm.state().q[-1], gripper.state().width) == pytest.approx(before, abs=1e-6)
        assert gripper.limits.width_min + 0.004 < before[1], (
            "the fingers did not go on to their goal"
        )
        return before


def children_of(pid: int) -> list[int]:
    """Return the processes that a process has started, the oldest first."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def wait_for_end(pid: int) -> None:
    """Wait until a process has ended, whose parent may not have noticed."""
    deadline = time.monotonic() + 300.0  # of a busy machine: the run draws its picture
    while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < deadline, "the run goes on"
        time.sleep(0.05)


def test_a_second_run_on_the_same_wires_is_refused_and_the_first_goes_on(
    gripper_place: Place, tmp_path: Path
) -> None:
    copy = tmp_path / "copy.yaml"
    copy.write_text(gripper_place.cell.read_text())
    with moving(gripper_place, "launched") as process:
        places = [
            str(gripper_place.tree),
            "--cell",
            str(copy),
            "--record",
            str(gripper_place.records),
        ]
        order = ["run", *places, "--cleared"]
        second = subprocess.run(
            [sys.executable, "-c", RUN, "launched", *order], capture_output=True, text=True
        )
        assert second.returncode == 2
        assert "another run is going on on 127.0.0.1:" in second.stderr
        assert process.poll() is None
        process.terminate()
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3, said
    assert len(list(gripper_place.records.iterdir())) == 1


def test_a_stopped_launcher_ends_its_run_in_the_safe_state_and_a_moment_of_it_does_not(
    gripper_place: Place,
) -> None:
    with moving(gripper_place, "launched") as process:
        (run,) = children_of(process.pid)
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        process.send_signal(signal.SIGCONT)
        time.sleep(1.0)
        assert children_of(process.pid) == [run]
        process.send_signal(signal.SIGSTOP)
        try:
            wait_for_end(run)
        finally:
            process.send_signal(signal.SIGCONT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3, said
    (record,) = gripper_place.records.iterdir()
    assert not (record / "supervisor.json").exists()
    fingers_stand(gripper_place)


def test_a_stopped_child_of_the_launcher_is_continued_and_ends_in_the_safe_state(
    gripper_place: Place,
) -> None:
    with moving(gripper_place, "launched") as process:
        (run,) = children_of(process.pid)
        os.kill(run, signal.SIGSTOP)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3, said
    (record,) = gripper_place.records.iterdir()
    assert not (record / "supervisor.json").exists()
    fingers_stand(gripper_place)


def test_the_devices_of_a_killed_child_of_the_launcher_are_stopped(gripper_place: Place) -> None:
    with moving(gripper_place, "launched") as process:
        (run,) = children_of(process.pid)
        os.kill(run, signal.SIGKILL)
        assert process.stderr is not None
        said = process.stderr.read()
        assert process.wait(30) == -signal.SIGKILL, said
    assert "gripper stopped" in said
    fingers_stand(gripper_place)


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_run_without_its_supervisor_ends_in_the_safe_state(
    gripper_place: Place, number: int
) -> None:
    with moving(gripper_place, "launched") as process:
        (run,) = children_of(process.pid)
        (supervisor,) = [
            pid
            for pid in children_of(run)
            if b"supervise" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]
        os.kill(supervisor, number)
        try:
            _, said = process.communicate(timeout=60)
        finally:
            with contextlib.suppress(
                ProcessLookupError
            ):  # the run ends a supervisor that does not answer
                os.kill(supervisor, signal.SIGKILL)
    assert process.returncode == 3, said
    fingers_stand(gripper_place)


@pytest.mark.parametrize(
    "whole", [False, True], ids=["it alone", "with its supervisor and devices"]
)
def test_a_stopped_run_ends_in_the_safe_state_with_a_whole_record(
    place: Place, whole: bool
) -> None:
    with moving(place, "go on") as process:
        stopped = [process.pid, *children_of(process.pid)]
        stopped += [
            pid
            for pid in children_of(os.getpid())
            if b"emulate" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]
        for pid in stopped if whole else stopped[:1]:
            os.kill(pid, signal.SIGSTOP)
        if whole:
            time.sleep(5.0)  # the heartbeat's deadline is 4 s
            for pid in stopped:
                os.kill(pid, signal.SIGCONT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 3, said
    (record,) = place.records.iterdir()
    assert not (record / "supervisor.json").exists()
    story = subprocess.run(
        [sys.executable, "-m", "pomona.executive.cli", "explain", str(record)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert "the run stalled for " in " ".join(story.stdout.split()), story.stdout + story.stderr
    assert is_at_rest(place)[0] < 0.9


def test_a_run_that_is_stopped_again_and_again_for_a_moment_goes_on(place: Place) -> None:
    with moving(place, "go on") as process:
        for _ in range(10):
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.1)
            process.send_signal(signal.SIGCONT)
            time.sleep(0.1)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "stalled" not in said
    assert is_at_rest(place)[0] < 0.9


@pytest.mark.parametrize(("way", "number"), [("hang", None), ("go on", signal.SIGKILL)])
def test_arm_and_gripper_are_stopped_from_outside_and_free_for_the_next_run(
    place: Place, way: str, number: int | None
) -> None:
    with moving(place, way) as process:
        if number is not None:
            process.send_signal(number)
        assert process.stderr is not None
        said = process.stderr.read()
        assert process.wait(30) == -signal.SIGKILL, said
    assert "arm stopped; gripper stopped" in said
    (record,) = place.records.iterdir()
    assert json.loads((record / "supervisor.json").read_text())["devices"] == {
        "arm": "stopped",
        "gripper": "stopped",
    }
    assert 0.0 < is_at_rest(place)[0] < 0.9, said
