"""pyrender through EGL, arranged so that it lives in one process with MuJoCo's EGL renderer.

All OpenGL work happens in one thread of its own: a context belongs to the thread in which it is current, so nothing
that another library makes current elsewhere is disturbed, and callers may come from any thread. The renderer is never
deleted, since deleting it terminates the display that other renderers of the process use.
"""

from __future__ import annotations

import ctypes
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Intrinsics
from skills.refine.errors import RenderFailed
from skills.refine.render import NEAR, DepthImage, ImageBox, Triangles

Float64 = NDArray[np.float64]

_TILE = 32
"""The viewport is rounded up to multiples of this [px]: a new size costs a new frame buffer."""

_MESHES_KEPT = 8
_FLIP_Y_Z = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera looks along -z with y up."""


def load_pyrender() -> ModuleType:
    """Import pyrender for off-screen rendering and leave PyOpenGL usable for MuJoCo.

    Raises:
        RenderFailed: pyrender or EGL does not load.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    if not hasattr(np, "infty"):  # pyrender 0.1.45 still uses numpy 1's name
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    try:
        import pyrender
        from OpenGL import EGL
    except Exception as error:  # a missing system library shows as ImportError, AttributeError or OSError
        raise RenderFailed(
            f"pyrender cannot use EGL ({error}): install libegl1, or render with the z-buffer (renderer: zbuffer)"
        ) from error
    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = ctypes.c_void_p  # absent in PyOpenGL 3.1.0; MuJoCo's EGL import needs it
    module: ModuleType = pyrender
    return module


class _GlRenderer:
    """pyrender's renderer and the meshes that it has uploaded. Used from one thread only."""

    def __init__(self) -> None:
        self._pyrender = load_pyrender()
        self._flags = (
            # SEG switches multisampling off, so depth is taken at pixel centres and not at a sample beside them.
            self._pyrender.RenderFlags.SEG
            | self._pyrender.RenderFlags.DEPTH_ONLY
            | self._pyrender.RenderFlags.SKIP_CULL_FACES
        )
        self._offscreen = self._pyrender.OffscreenRenderer(_TILE, _TILE)
        self._scenes: dict[tuple[int, int], tuple[Triangles, Any, Any, Any]] = {}

    def render(self, mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
        scene, node, camera = self._scene(mesh)
        rows, columns = box.shape
        width, height = (-(-size // _TILE) * _TILE for size in (columns, rows))
        z = mesh.vertices @ T_camera_mesh[2, :3] + T_camera_mesh[2, 3]
        if z.min() <= NEAR:
            raise RenderFailed("the fruit's pose is behind the camera or touches it: the detection is wrong")
        # Tight planes: the 24 bits of the depth buffer are spent on the fruit alone.
        camera.znear, camera.zfar = 0.98 * float(z.min()), 1.02 * float(z.max())
        camera.fx, camera.fy = intrinsics.fx, intrinsics.fy
        camera.cx, camera.cy = intrinsics.cx - box.left + 0.5, intrinsics.cy - box.top + 0.5
        scene.set_pose(node, _FLIP_Y_Z @ T_camera_mesh)
        self._offscreen.viewport_width, self._offscreen.viewport_height = width, height
        depth = self._offscreen.render(scene, self._flags, {node: 255})
        cut: DepthImage = np.ascontiguousarray(depth[:rows, :columns])
        return cut

    def _scene(self, mesh: Triangles) -> tuple[Any, Any, Any]:
        """A scene with the mesh and a camera; kept, since uploading costs more than rendering."""
        key = (id(mesh.vertices), id(mesh.faces))
        if key not in self._scenes:
            while len(self._scenes) >= _MESHES_KEPT:
                self._scenes.pop(next(iter(self._scenes)))
            primitive = self._pyrender.Primitive(
                positions=mesh.vertices.astype(np.float32), indices=mesh.faces.astype(np.uint32), mode=4
            )
            scene = self._pyrender.Scene()
            node = scene.add(self._pyrender.Mesh([primitive]))
            camera = self._pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0)
            scene.add(camera)
            self._scenes[key] = (mesh, scene, node, camera)  # holding the mesh keeps its arrays' ids from being reused
        _, scene, node, camera = self._scenes[key]
        return scene, node, camera


_lock = threading.Lock()
_thread: ThreadPoolExecutor | None = None
_renderer: _GlRenderer | None = None


def render_with_gl(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
    """`render.DepthRenderer` by pyrender; may be called from any thread.

    Raises:
        RenderFailed: OpenGL does not work here, or a part of the mesh is not in front of the camera.
    """
    global _thread
    with _lock:
        if _thread is None:
            _thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="pyrender")
    try:
        return _thread.submit(_render, mesh, T_camera_mesh, intrinsics, box).result()
    except RenderFailed:
        raise
    except Exception as error:  # PyOpenGL raises many kinds; none of them is this caller's fault
        raise RenderFailed(f"pyrender could not render ({type(error).__name__}: {error})") from error


def _render(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
    global _renderer
    if _renderer is None:
        _renderer = _GlRenderer()
    return _renderer.render(mesh, T_camera_mesh, intrinsics, box)
