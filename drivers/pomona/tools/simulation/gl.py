"""Off-screen OpenGL for the simulated camera: EGL (on macOS CGL), and one thread that owns every context made here.

A context is current in one thread only, so nothing that another library (pyrender) makes current elsewhere is
disturbed, and callers may come from any thread. Both libraries work in one process in either order.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from typing import Any, TypeVar

from pomona.drivers.errors import DeviceFault
from pomona.executive.values.installation import import_under, load_mujoco as load_mujoco

T = TypeVar("T")

_lock = threading.Lock()
_thread: ThreadPoolExecutor | None = None


def open_renderer(model: Any, height: int, width: int) -> Any:
    """Create a `mujoco.Renderer` through EGL, without a display. Call it, and the renderer, in the GL thread.

    Raises DeviceFault: EGL does not work on this machine; the text names the missing packages.
    """
    mujoco = load_mujoco()
    try:
        if sys.platform != "darwin":
            _prepare_egl()
        # MuJoCo chose its backend when it was first imported, perhaps by a caller that renders nothing.
        gl_context = import_under("mujoco.rendering.classic.gl_context", MUJOCO_GL="disable")
        gl_context.GLContext = import_module(
            "mujoco.cgl" if sys.platform == "darwin" else "mujoco.egl"
        ).GLContext
        return mujoco.Renderer(model, height, width)
    except (
        Exception
    ) as error:  # a missing library shows as ImportError, AttributeError, OSError or an EGL error
        raise DeviceFault(
            "camera",
            f"the simulated camera cannot render ({type(error).__name__}: {error}); install EGL: "
            "apt install libegl1 libegl-mesa0 libgl1-mesa-dri libopengl0",
        ) from error


def in_gl_thread(function: Callable[[], T]) -> T:
    """Call a function in the thread that owns the contexts, and wait for its result."""
    global _thread
    with _lock:
        if _thread is None:
            _thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sim-gl")
    return _thread.submit(function).result()


def _prepare_egl() -> None:
    """Heal PyOpenGL 3.1.0, which pyrender pins.

    It lacks a type that MuJoCo's EGL binding names; and once its EGL part is imported, it compares extension names in
    bytes with a prefix in str, which breaks a later import of pyrender.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    from OpenGL import EGL
    from OpenGL.raw.EGL import _types

    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = ctypes.c_void_p
    querier = _types.EGLQuerier
    for name in ("prefix", "version_prefix"):
        if isinstance(getattr(querier, name), str):
            setattr(querier, name, getattr(querier, name).encode())
