"""Looks over a machine before a run: Python, packages, extras, graphics, a browser, the folder of records.

Before the search for a package only Python's standard library is imported, so that the report works with few packages.
"""

from __future__ import annotations

import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from pomona.executive.values.installation import (
    further_checks,
    import_under,
    install_extra,
    pip,
)
from pomona.executive.values.sentences import ReportLine

MODULES = {
    "onnxruntime": "onnxruntime",
    "opencv-python-headless": "cv2",
    "mujoco-core": "mujoco",
    "ompl": "ompl",
    "numba": "numba",
    "scipy": "scipy",
    "pyrender": "pyrender",
}
"""Packages that are imported, too, since they stand on libraries of the system, and the modules that do it."""
EXTRAS = {
    "ros2": ("rosbags", "eclipse-zenoh"),
    "lerobot": ("pyarrow",),
    "realsense": ("pyrealsense2",),
    "torch": ("torch", "onnx"),
    "lsp": ("pygls",),
    "mcp": ("mcp",),
}
"""Optional features with the packages that each installs."""
HEADLESS = {"MUJOCO_GL": "disable", "PYOPENGL_PLATFORM": "egl"}
"""Environment in which packages are imported, as a run imports them: PyOpenGL chooses its platform once."""

EGL = "apt install libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0"
ROOM = 1e9  # minimum free space for a folder of records [byte]: some hundred picks


def examine_machine(records: Path) -> Iterator[ReportLine]:
    """Check the requirements of every run on this machine.

    Args:
        records: the folder in which runs leave their records; it need not be there.
    """
    yield ReportLine("Python", True, f"{platform.python_version()} ({sys.executable})")
    yield from _packages()
    yield from _extras()
    yield _graphics()
    yield from further_checks()
    found = next(
        (name for name in ("chromium", "chromium-browser", "google-chrome") if shutil.which(name)),
        None,
    )
    yield ReportLine(
        "browser for tests",
        True,
        found or "none; only tests of the page need one: apt install chromium",
    )
    yield _room(records)


def _packages() -> Iterator[ReportLine]:
    """Check every package that Pomona declares, with an import of compiled ones."""
    try:
        declared = requires("pomona") or []
    except PackageNotFoundError:
        declared = []
        yield ReportLine(
            "pomona", False, "is not installed in this Python", "make run, or pip install its wheel"
        )
    for requirement in declared:
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        if "extra ==" in requirement:
            continue
        try:
            found = version(name)
        except PackageNotFoundError:
            wanted = requirement.partition(";")[0].strip()
            yield ReportLine(name, False, "is not installed", f"{pip()} install '{wanted}'")
            continue
        try:
            if name in MODULES:
                import_under(MODULES[name], **HEADLESS)
        except (
            ModuleNotFoundError
        ) as error:  # of another package, which has a line of its own if it is declared
            missing = (error.name or name).partition(".")[0]
            yield ReportLine(
                name, False, f"cannot be imported: {error}", f"{pip()} install {missing}"
            )
        except Exception as error:  # a missing system library shows in many ways
            advice = (
                f"a library of the system is missing, or: {pip()} install --force-reinstall {name}"
            )
            yield ReportLine(
                name, False, f"cannot be imported: {error}", EGL if name == "pyrender" else advice
            )
        else:
            yield ReportLine(name, True, found)


def _extras() -> Iterator[ReportLine]:
    """Which are there. Nothing is imported, and one that is not there is no fault."""
    for extra, packages in EXTRAS.items():
        try:
            found = ", ".join(f"{package} {version(package)}" for package in packages)
        except PackageNotFoundError:
            absent = f"not installed; {install_extra(extra)}"
            yield ReportLine(f"extra {extra}", True, absent, absent=True)
        else:
            yield ReportLine(f"extra {extra}", True, found)


def _graphics() -> ReportLine:
    """Whether something can be drawn: a library that is there may still find no driver."""
    try:
        from pomona.tools.simulation.gl import in_gl_thread, load_mujoco, open_renderer

        mujoco = load_mujoco()
        model = mujoco.MjModel.from_xml_string("<mujoco/>")
        drawn = in_gl_thread(lambda: _drawn(open_renderer(model, 16, 16), mujoco.MjData(model)))
    except Exception as error:  # MuJoCo that is not there, no library, no driver, no device
        return ReportLine("EGL", False, f"nothing can be rendered: {error}", EGL)
    return ReportLine("EGL", True, f"renders with {drawn}")


def _drawn(renderer: object, data: object) -> str:
    """Draw an empty scene; who drew it."""
    from OpenGL import GL

    renderer.update_scene(data)  # type: ignore[attr-defined]
    renderer.render()  # type: ignore[attr-defined]
    name: bytes = GL.glGetString(GL.GL_RENDERER)
    renderer.close()  # type: ignore[attr-defined]
    return name.decode(errors="replace")


def _room(records: Path) -> ReportLine:
    """Whether a record can be written, and how much room there is."""
    name = "folder of records"
    where = records.absolute()
    there = next(folder for folder in (where, *where.parents) if folder.exists())
    advice = "--record DIR names another folder; --no-record leaves none"
    try:
        with tempfile.TemporaryFile(dir=there):
            free = shutil.disk_usage(there).free
    except OSError as error:
        return ReportLine(name, False, f"{where} cannot be written: {error.strerror}", advice)
    return ReportLine(
        name, free > ROOM, f"{where}, {free / 1e9:.1f} GB free", f"too little room; {advice}"
    )
