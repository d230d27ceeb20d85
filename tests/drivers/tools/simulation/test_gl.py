"""MuJoCo's and pyrender's off-screen contexts live in one process, whichever comes first."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[4]

MUJOCO = """
from pomona.executive.cell.connect import load_cell
from pomona.drivers.interfaces import Camera

cell = load_cell("trees/cells/sim.yaml", seed=1)
def look():
    cell.clock.advance(0.04)
    frame = cell.device(Camera).latest()
    return float(frame.colour.mean()), float((frame.depth > 0).mean())
"""
PYRENDER = """
import numpy as np
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.render import render_with_gl
from pomona.skills.perception.refinement.render import ImageBox
fruit = load_fruit("apple")
T = np.eye(4); T[2, 3] = 0.5
def draw():
    depth = render_with_gl(fruit, T, Intrinsics(600.0, 600.0, 320.0, 240.0, 640, 480), ImageBox(240, 160, 400, 320))
    return float(depth[80, 80])
"""
USE = """
for _ in range(2):
    brightness, seen = look()
    assert 30 < brightness < 220 and seen > 0.9, (brightness, seen)
    assert 0.4 < draw() < 0.5
cell.close()
assert 0.4 < draw() < 0.5
print("both work")
"""


@pytest.mark.parametrize(
    ("order", "backend"),
    [
        (MUJOCO + "look()\n" + PYRENDER, "egl"),
        (PYRENDER + "draw()\n" + MUJOCO, "egl"),
        ("import mujoco\n" + MUJOCO + PYRENDER, None),
    ],
    ids=["mujoco first", "pyrender first", "mujoco imported for physics before"],
)
def test_both_renderers_work_in_one_process(order, backend):
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")
    }
    if backend:
        environment["MUJOCO_GL"] = backend
    done = subprocess.run(
        [sys.executable, "-c", order + USE],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "both work" in done.stdout


@pytest.mark.parametrize("backend", ["egl", "osmesa", "glfw", "nonsense"])
def test_skills_and_robot_files_are_read_whatever_backend_the_environment_asks_for(backend):
    script = (
        "import os; from pathlib import Path; import pomona.skills.move_to\n"
        "from pomona.drivers.robot_file import read_limits\n"
        "print(read_limits(Path('trees/robots/sia5f_wsg32.xml')).velocity.shape, os.environ['MUJOCO_GL'])"
    )
    environment = {**os.environ, "MUJOCO_GL": backend}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["(7,)", backend]


def test_without_a_driver_of_egl_one_line_names_the_packages():
    script = MUJOCO + "try:\n    look()\nexcept Exception as error:\n    print(error)\n"
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_DIRS": "/nowhere"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    (line,) = done.stdout.splitlines()
    assert line.startswith("camera: the simulated camera cannot render (")
    assert line.endswith("install EGL: apt install libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0")
