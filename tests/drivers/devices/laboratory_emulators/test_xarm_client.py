"""The vendor's own client accepts the emulated controller; both in processes of their own."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator

import pytest

CLIENT = """
import json, sys, time
from xarm.wrapper import XArmAPI

arm = XArmAPI(sys.argv[1], is_radian=True, report_type=sys.argv[2], forbid_uds=True)
found = dict(axis=arm.axis, type=arm.device_type, version=arm.version_number, angles=arm.get_servo_angle(is_real=True))
found["enabled"] = [arm.motion_enable(True), arm.set_mode(0), arm.set_state(0)]
goal = [q + 0.2 for q in found["angles"][1][: arm.axis]]
found["moved"] = [arm.set_servo_angle(angle=goal, speed=1.0, mvacc=5.0, wait=True, timeout=10)]
found["moved"].append(arm.get_servo_angle()[1])
found["servo mode"] = [arm.set_mode(1), arm.set_state(0)]
time.sleep(0.1)
found["servo"] = []
for i in range(50):
    found["servo"].append(arm.set_servo_angle_j([q + 0.002 * i for q in goal]))
    time.sleep(0.004)
time.sleep(0.5)
found["states"] = arm.get_joint_states(num=3)
found["report"] = dict(angles=arm.angles, state=arm.state, mode=arm.mode, error=arm.error_code)
found["speeds mode"] = [arm.set_mode(4), arm.set_state(0)]
time.sleep(0.1)
found["speeds"] = arm.vc_set_joint_velocity([0.2] * arm.axis, duration=0.2)
time.sleep(1.0)
found["speed after"] = max(map(abs, arm.get_joint_states(num=2)[1][1]))
found["stopped"] = [arm.set_state(4), arm.get_state()]
found["errors"] = arm.get_err_warn_code()
arm.disconnect()
print("FOUND " + json.dumps(found))
"""


@contextlib.contextmanager
def emulated(host: str, *options: str) -> Iterator[str]:
    command = [
        sys.executable,
        "-m",
        "pomona.devices.emulators.command_emulate",
        "xarm",
        "--host",
        host,
        *options,
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            for _ in range(4):
                if not process.stdout.readline():
                    if "Permission denied" in process.stderr.read():
                        pytest.skip(
                            "this account may not listen at port 502, which the vendor's client needs"
                        )
                    pytest.fail("the emulator did not start")
            yield host
        finally:
            process.terminate()


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("model", "axes", "report"),
    [("xarm6", 6, "rich"), ("xarm7", 7, "real"), ("lite6", 6, "normal")],
)
def test_ufactory_s_client_reads_moves_and_streams(model: str, axes: int, report: str) -> None:
    if importlib.util.find_spec("xarm") is None:
        pytest.skip("xarm-python-sdk, of the extra dev, is not installed")
    with emulated("127.0.0.94", "--model", model) as host:
        ran = subprocess.run(
            [sys.executable, "-c", CLIENT, host, report],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout.split("FOUND ")[1])
    assert (found["axis"], found["type"], found["version"]) == (
        axes,
        {"lite6": 9}.get(model, axes),
        [2, 5, 0],
    )
    code, start = found["angles"]
    assert code == 0
    assert (found["enabled"], found["servo mode"], found["speeds mode"]) == (
        [0, 0, 0],
        [0, 0],
        [0, 0],
    )
    goal = [q + 0.2 for q in start[:axes]]
    assert found["moved"][0] == 0
    assert found["moved"][1][:axes] == pytest.approx(goal, abs=2e-3)
    assert found["servo"] == [0] * 50
    reached = [q + 0.098 for q in goal]
    assert found["states"][0] == 0
    assert found["states"][1][0][:axes] == pytest.approx(reached, abs=2e-3)
    assert found["report"]["angles"][:axes] == pytest.approx(reached, abs=2e-3)
    assert (found["report"]["state"], found["report"]["mode"], found["report"]["error"]) == (
        2,
        1,
        0,
    )
    assert found["speeds"] == 0
    assert found["speed after"] < 1e-3
    assert found["stopped"][1] == [0, 4]
    assert found["errors"] == [0, [0, 0]]
