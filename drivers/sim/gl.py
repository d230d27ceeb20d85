"""Off-screen OpenGL for the simulated camera: one thread that owns every context made here.

A context is current in one thread only, so nothing that another library (pyrender) makes current elsewhere is
disturbed, and callers may come from any thread. Both libraries work in one process in either order.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import TypeVar

T = TypeVar("T")

_lock = threading.Lock()
_thread: ThreadPoolExecutor | None = None


def load_mujoco() -> ModuleType:
    """Import MuJoCo so that it renders through EGL, without a display.

    PyOpenGL 3.1.0, which pyrender pins, lacks a type that MuJoCo's EGL binding names.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    os.environ.setdefault("MUJOCO_GL", "egl")
    from OpenGL import EGL

    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = ctypes.c_void_p
    import mujoco

    module: ModuleType = mujoco
    return module


def in_gl_thread(function: Callable[[], T]) -> T:
    """Call a function in the thread that owns the contexts, and wait for its result."""
    global _thread
    with _lock:
        if _thread is None:
            _thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sim-gl")
    return _thread.submit(function).result()
