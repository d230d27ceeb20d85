"""Virtual depth by pyrender as it comes, through its documented interface alone: the yardstick of Refine's renderer."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Intrinsics
from pomona.skills.perception.refinement.render import (
    DepthImage,
    ImageBox,
    Triangles,
    load_pyrender,
)

_FLIP_Y_Z = np.diag([1.0, -1.0, -1.0, 1.0])
"""OpenGL's camera looks along -z with y up."""


def render_with_plain_pyrender(
    mesh: Triangles, T_camera_mesh: NDArray[np.float64], intrinsics: Intrinsics, box: ImageBox
) -> DepthImage:
    """`render.DepthRenderer` by `pyrender.OffscreenRenderer.render`; scene and context are kept, one thread."""
    pyrender = load_pyrender()
    scene, node, camera = _scene(mesh)
    z = mesh.vertices @ T_camera_mesh[2, :3] + T_camera_mesh[2, 3]
    camera.znear, camera.zfar = 0.98 * float(z.min()), 1.02 * float(z.max())
    camera.fx, camera.fy = intrinsics.fx, intrinsics.fy
    camera.cx, camera.cy = intrinsics.cx - box.left + 0.5, intrinsics.cy - box.top + 0.5
    scene.set_pose(node, _FLIP_Y_Z @ T_camera_mesh)
    # SEG switches multisampling off, so depth is taken at pixel centres and not at a sample beside them.
    flags = pyrender.RenderFlags.SEG | pyrender.RenderFlags.DEPTH_ONLY
    offscreen = _offscreen()
    offscreen.viewport_height, offscreen.viewport_width = box.shape
    depth: DepthImage = np.ascontiguousarray(offscreen.render(scene, flags, {node: 255}))
    return depth


@lru_cache(maxsize=1)
def _offscreen() -> Any:
    return load_pyrender().OffscreenRenderer(32, 32)


@lru_cache(maxsize=4)
def _scene(mesh: Triangles) -> tuple[Any, Any, Any]:
    pyrender = load_pyrender()
    primitive = pyrender.Primitive(
        positions=mesh.vertices.astype(np.float32), indices=mesh.faces.astype(np.uint32), mode=4
    )
    scene = pyrender.Scene()
    node = scene.add(pyrender.Mesh([primitive]))
    camera = pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0)
    scene.add(camera)
    return scene, node, camera
