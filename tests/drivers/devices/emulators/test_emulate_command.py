"""`pomona emulate` as a process of its own, spoken to with bytes."""

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial

from pomona.devices.emulators.command_emulate import main
from pomona.devices.suntouch.codec import SIZE, decode
from pomona.devices.suntouch.fit import read_recording


@contextlib.contextmanager
def emulated(*arguments: str) -> Iterator[str]:
    command = [sys.executable, "-m", "pomona.devices.emulators.command_emulate", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
    assert process.returncode == 0


def exchange(address: str, request: bytes, size: int) -> bytes:
    host, _, port = address.rpartition(":")
    with socket.create_connection((host, int(port)), 5.0) as connection:
        connection.sendall(request)
        answer = b""
        while len(answer) < size:
            answer += connection.recv(size - len(answer))
    return answer


def test_the_gripper_answers_the_public_check_frames() -> None:
    with emulated("wsg", "--tcp", "127.0.0.1:0") as address:
        stop = bytes.fromhex("aa aa aa 22 00 00 0e 76")
        answer = exchange(address, stop, 10)
    assert answer[:8] == bytes.fromhex("aa aa aa 22 02 00 00 00")


def test_a_gripper_without_a_reference_refuses_to_move() -> None:
    with emulated("wsg", "--tcp", "127.0.0.1:0", "--not-referenced") as address:
        move = bytes.fromhex("aa aa aa 21 09 00 02 00 00 f0 41 00 00 48 42 5b 99")
        answer = exchange(address, move, 10)
    assert answer[3:8] == bytes.fromhex("21 02 00 03 00")  # NOT_INITIALIZED


def test_a_finger_answers_50_bytes_on_its_terminal(tmp_path: Path) -> None:
    link = tmp_path / "finger"
    with emulated("suntouch", "--link", str(link)) as address:
        assert address == str(link)
        with serial.Serial(str(link), 1_000_000, timeout=5.0) as port:
            port.write(b"a")
            reading = decode(port.read(SIZE))
    assert 1.0 < reading.volts.mean() < 2.0


def test_a_recording_for_the_fitter_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.npz"
    assert main(["suntouch", "--record", str(path), "--samples", "50"]) == 0
    volts, wrenches = read_recording(path)
    assert volts.shape == (50, 25)
    assert np.all(wrenches[:, 2] <= 0.0)
    assert "50 samples" in capsys.readouterr().out


def test_a_taken_port_is_reported_without_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["wsg", "--tcp", f"127.0.0.1:{port}"]) == 2
    assert "cannot be opened" in capsys.readouterr().err
