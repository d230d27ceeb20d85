"""Virtual depth of one mesh, behind one small interface: restricted to an image box, by a renderer to choose."""

from __future__ import annotations

from functools import cache

import numpy as np

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.fruit import Mesh
from pomona.skills.perception.refinement.depth_image import (
    NEAR,
    DepthImage,
    DepthRenderer,
    ImageBox,
    RendererName,
    Triangles,
)
from pomona.skills.perception.refinement.errors import RenderFailed


def renderer(name: RendererName) -> DepthRenderer:
    """Return the renderer of a name: pyrender (OpenGL through EGL, the default) or zbuffer (compiled loops, no OpenGL).

    Raises RenderFailed: no such renderer, or its libraries do not work on this machine.
    """
    if name == "pyrender":
        from pomona.skills.perception.refinement.gl import render_with_gl

        return render_with_gl
    if name == "zbuffer":
        from pomona.skills.perception.refinement.zbuffer import render_with_zbuffer

        return render_with_zbuffer
    raise RenderFailed(f"there is no renderer named {name!r}: choose pyrender or zbuffer")


_PROBE_CAMERA = Intrinsics(40.0, 40.0, 10.0, 10.0, 21, 21)
_PROBE = Mesh(np.array([[-0.1, -0.1, 0.5], [0.1, -0.1, 0.5], [0.0, 0.1, 0.5]]), np.array([[0, 1, 2]], dtype=np.int32))
"""A triangle in front of the camera [m]."""


@cache
def usable_renderer(name: RendererName) -> tuple[RendererName, str]:
    """Return a renderer that works in this process: the named one, or the z-buffer with the reason why.

    It is tried once, since a library that cannot be imported, or a context that does not open, stays so.
    """
    try:
        render_depth(_PROBE, np.eye(4), _PROBE_CAMERA, using=name)
    except RenderFailed as error:
        return "zbuffer", f"virtual depth comes from the z-buffer: {error}"
    return name, ""


def image_box(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, margin: int = 2) -> ImageBox:
    """Return the part of the image that a posed mesh can cover, with a margin [px].

    Raises RenderFailed: the mesh is behind the camera, or outside the image.
    """
    K = np.array([[intrinsics.fx, 0.0, intrinsics.cx], [0.0, intrinsics.fy, intrinsics.cy], [0.0, 0.0, 1.0]])
    x, y, z = K @ T_camera_mesh[:3, :3] @ mesh.vertices.T + (K @ T_camera_mesh[:3, 3])[:, np.newaxis]
    if z.min() <= NEAR:
        raise RenderFailed("the fruit's pose is behind the camera or touches it: the detection is wrong")
    u, v = x / z, y / z
    left, right = max(u.min(), -1e6), min(u.max(), 1e6)
    top, bottom = max(v.min(), -1e6), min(v.max(), 1e6)
    box = ImageBox(int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)) + 1, int(np.ceil(bottom)) + 1)
    box = box.grown(margin, intrinsics)
    if box.right <= box.left or box.bottom <= box.top:
        raise RenderFailed("the fruit's pose lies outside the image: the detection is wrong")
    return box


def render_depth(
    mesh: Triangles,
    T_camera_mesh: Float64,
    intrinsics: Intrinsics,
    box: ImageBox | None = None,
    using: RendererName = "pyrender",
) -> tuple[DepthImage, ImageBox]:
    """Render the z-depth of one mesh; return it, float32 [m], 0 where it is not seen, and its box of the image.

    Args:
        mesh: anything with `vertices` and `faces`.
        T_camera_mesh: maps mesh coordinates into the camera frame, shape (4, 4); its linear part may scale.
        box: part of the image to render; the mesh's own box by default.

    Raises RenderFailed: the mesh is behind the camera or outside the image, or the renderer does not work here.
    """
    covered = image_box(mesh, T_camera_mesh, intrinsics) if box is None else box
    return renderer(using)(mesh, T_camera_mesh, intrinsics, covered), covered
