"""Depth images: their data and checks, and the virtual depth of one mesh in a box of the image.

pyrender works through EGL, beside MuJoCo's EGL renderer; the z-buffer in compiled loops needs no OpenGL. A program with
one matrix draws a mesh that pyrender uploaded into a buffer of depth alone: pyrender's own `render` spends most of its
time on colour and on walking the scene. The picture equals pyrender's (tested).

A context belongs to the thread in which it is current. This one is current for one call, under a lock; afterwards the
context before is current again. The renderer is never deleted, since that terminates the display of other renderers.
"""

from __future__ import annotations

import ctypes
import os
import threading
from dataclasses import dataclass, field
from functools import cache, lru_cache
from types import ModuleType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.executive.values.rotations import is_rigid
from pomona.skills.perception.fruit import Mesh
from pomona.skills.perception.rasteriser import draw, project
from pomona.skills.perception.refinement.errors import BadDepth, BadMesh, BadPose, RenderFailed

DepthImage = NDArray[np.float32]
RendererName = Literal["pyrender", "zbuffer"]

NEAR = 0.01  # nothing nearer to the camera than this is rendered [m]


class Triangles(Protocol):
    """A triangle mesh, such as a `FruitModel`: vertices (n, 3) float64 [m], faces (m, 3) integer."""

    @property
    def vertices(self) -> Float64:
        """Shape (n, 3) [m]."""

    @property
    def faces(self) -> NDArray[np.int32]:
        """Indices of vertices, shape (m, 3)."""

    def __hash__(self) -> int: ...


@dataclass(frozen=True, slots=True)
class ImageBox:
    """A rectangle of whole pixels: columns `left` to `right - 1`, rows `top` to `bottom - 1`."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)"""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """The box's part of an image: `image[box.slices]`."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, margin: int, intrinsics: Intrinsics) -> ImageBox:
        """Return the box with a margin [px], cut to the image."""
        return ImageBox(
            max(self.left - margin, 0),
            max(self.top - margin, 0),
            min(self.right + margin, intrinsics.width),
            min(self.bottom + margin, intrinsics.height),
        )


class DepthRenderer(Protocol):
    """Renders z-depth through the pixel centres of a box."""

    def __call__(
        self, mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox
    ) -> DepthImage:
        """Return the depth of shape `box.shape`, float32 [m]; 0 where the mesh is not seen."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of accepted measurements."""

    # half-width of the band in which depth agrees with the model [m], where the camera's noise is less
    inlier_band: float = 4e-3
    min_inliers: float = 0.3  # minimum ratio of agreeing measured pixels
    size: tuple[float, float] = (0.4, 1.6)  # least and largest size relative to the model


@dataclass(frozen=True, slots=True, eq=False)
class RefineResult:
    """A fruit's refined pose and size, in the camera frame."""

    T_camera_object: Float64  # pose of the refined shape's cuboid
    dimensions: Float64  # (d_x, d_y, d_z) [m], shape (3,)
    mu: float  # mu, sigma: scale factor and displacement [m] of the uniform fit (the paper's)
    sigma: float
    covariance: Float64  # of (position in the camera frame, dimensions), shape (6, 6) [m²]
    inlier_ratio: float  # ratio of the refined model's measured pixels with agreeing depth
    residual: float  # root mean square of the inliers' depth residuals [m]
    box: ImageBox  # part of the image that the next two cover
    inliers: NDArray[np.bool_]  # pixels that agree, bool, shape `box.shape`
    virtual_depth: (
        DepthImage  # the refined model's z-depth, float32, shape `box.shape` [m]; 0 outside it
    )
    method: str  # the formulation that gave the result: paper, uniform, shape, shape+plane; `+views` with other looks


def check_depth(depth: object, intrinsics: Intrinsics) -> None:
    """Raises BadDepth: not an array of real numbers with the shape of the camera's image."""
    expected = (intrinsics.height, intrinsics.width)
    if not isinstance(depth, np.ndarray) or depth.dtype.kind not in "fiu":
        raise BadDepth(
            "the depth must be an array of real numbers [m]; this camera may be colour only"
        )
    if depth.shape != expected:
        raise BadDepth(
            f"the depth's shape is {depth.shape}, the intrinsics are of an image of shape {expected}"
        )


def check_pose(T_camera_object: Float64) -> None:
    """Raises BadPose: not a finite rigid transform."""
    if not is_rigid(T_camera_object, 1e-6):
        raise BadPose(f"not a rigid transform: {T_camera_object.tolist()}")


@lru_cache(maxsize=32)
def extents(mesh: Triangles) -> Float64:
    """Return the size of a mesh's cuboid (d_x, d_y, d_z) [m], shape (3,); remembered per mesh object.

    Raises BadMesh: empty, not finite, or of zero size in some direction. A mesh with holes is valid.
    """
    vertices = np.asarray(mesh.vertices)
    faces = np.asarray(mesh.faces)
    if (
        vertices.ndim != 2
        or vertices.shape[1:] != (3,)
        or faces.ndim != 2
        or faces.shape[1:] != (3,)
        or not len(faces)
    ):
        raise BadMesh("a mesh needs vertices of shape (n, 3) and at least one face of shape (m, 3)")
    if not np.isfinite(vertices).all():
        raise BadMesh("the mesh has vertices that are not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BadMesh(f"the mesh's faces name vertices that do not exist (it has {len(vertices)})")
    size: Float64 = np.ptp(vertices[np.unique(faces)], axis=0).astype(np.float64)
    if size.min() <= 0.0:
        raise BadMesh(
            f"the mesh measures {size.tolist()} m: it must have a size in all three directions"
        )
    size.flags.writeable = False
    return size


@lru_cache(maxsize=32)
def farthest(mesh: Triangles) -> float:
    """Return the greatest distance of a vertex from the mesh's origin [m]; remembered per mesh object."""
    return float(np.linalg.norm(mesh.vertices, axis=1).max())


@lru_cache(maxsize=32)
def winding(mesh: Triangles) -> int:
    """1: the mesh encloses a volume and its faces look outwards; -1: they look inwards; 0: it is not watertight."""
    vertices = np.asarray(mesh.vertices)
    faces = np.asarray(mesh.faces)
    _, welded = np.unique(vertices, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[faces]
    directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    there, times = np.unique(directed, axis=0, return_counts=True)
    back = np.unique(directed[:, ::-1], axis=0)
    if not np.array_equal(there, back) or times.max() > 1:
        return 0
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return int(np.sign(np.sum(np.cross(a, b) * c)))


def renderer(name: RendererName) -> DepthRenderer:
    """Return the renderer of a name: pyrender (OpenGL through EGL, the default) or zbuffer (compiled loops, no OpenGL).

    Raises RenderFailed: no such renderer, or its libraries do not work on this machine.
    """
    if name == "pyrender":
        return render_with_gl
    if name == "zbuffer":
        return render_with_zbuffer
    raise RenderFailed(f"there is no renderer named {name!r}: choose pyrender or zbuffer")


_PROBE_CAMERA = Intrinsics(40.0, 40.0, 10.0, 10.0, 21, 21)
_PROBE = Mesh(
    np.array([[-0.1, -0.1, 0.5], [0.1, -0.1, 0.5], [0.0, 0.1, 0.5]]),
    np.array([[0, 1, 2]], dtype=np.int32),
)
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


def image_box(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics) -> ImageBox:
    """Return the part of the image that a posed mesh can cover, with a margin of 2 px.

    Raises RenderFailed: the mesh is behind the camera, or outside the image.
    """
    K = np.array(
        [[intrinsics.fx, 0.0, intrinsics.cx], [0.0, intrinsics.fy, intrinsics.cy], [0.0, 0.0, 1.0]]
    )
    x, y, z = (
        K @ T_camera_mesh[:3, :3] @ mesh.vertices.T + (K @ T_camera_mesh[:3, 3])[:, np.newaxis]
    )
    if z.min() <= NEAR:
        raise RenderFailed(
            "the fruit's pose is behind the camera or touches it: the detection is wrong"
        )
    u = x / z
    v = y / z
    left = max(u.min(), -1e6)
    right = min(u.max(), 1e6)
    top = max(v.min(), -1e6)
    bottom = min(v.max(), 1e6)
    box = ImageBox(
        int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)) + 1, int(np.ceil(bottom)) + 1
    )
    box = box.grown(2, intrinsics)
    if box.right <= box.left or box.bottom <= box.top:
        raise RenderFailed("the fruit's pose lies outside the image: the detection is wrong")
    return box


def share_inside(
    mesh: Triangles, T_camera_mesh: Float64, box: ImageBox, intrinsics: Intrinsics
) -> float:
    """Return the ratio of a mesh's vertices inside the picture; those outside are hidden, too. `box` is the mesh's."""
    if (
        box.left > 0
        and box.top > 0
        and box.right < intrinsics.width
        and box.bottom < intrinsics.height
    ):
        return 1.0
    x, y, z = intrinsics.K @ (T_camera_mesh[:3, :3] @ mesh.vertices.T + T_camera_mesh[:3, 3:])
    inside = (x >= 0.0) & (x < intrinsics.width * z) & (y >= 0.0) & (y < intrinsics.height * z)
    return float(inside.mean())


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


_TILE = 32  # frame buffers are rounded up to multiples of this [px]: a new size costs a new one

_BUFFERS_KEPT = 8
_MESHES_KEPT = 8

_VERTEX_SHADER = """#version 330 core
layout(location = 0) in vec3 position;
uniform mat4 clip_from_mesh;
void main() { gl_Position = clip_from_mesh * vec4(position, 1.0); }
"""
_FRAGMENT_SHADER = """#version 330 core
void main() {}
"""


def load_pyrender() -> ModuleType:
    """Import pyrender for off-screen rendering and leave PyOpenGL usable for MuJoCo.

    Raises RenderFailed: pyrender or EGL does not load.
    """
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    if not hasattr(np, "infty"):  # pyrender 0.1.45 still uses numpy 1's name
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    try:
        import pyrender
        from OpenGL import EGL
    except (
        Exception
    ) as error:  # a missing system library shows as ImportError, AttributeError or OSError
        raise RenderFailed(
            f"pyrender cannot be imported ({error}); it needs EGL: apt install libegl1 libopengl0"
        ) from error
    if not hasattr(EGL, "EGLDeviceEXT"):
        EGL.EGLDeviceEXT = ctypes.c_void_p  # absent in PyOpenGL 3.1.0; MuJoCo's EGL import needs it
    module: ModuleType = pyrender
    return module


class _GlRenderer:
    """A context of pyrender's, a program, and the meshes and frame buffers that it keeps."""

    def __init__(self) -> None:
        self._pyrender = load_pyrender()
        from OpenGL import EGL, GL

        self._egl = EGL
        self._gl = GL
        self._offscreen = self._pyrender.OffscreenRenderer(
            _TILE, _TILE
        )  # leaves its context current
        self._display, self._context = EGL.eglGetCurrentDisplay(), EGL.eglGetCurrentContext()
        self._meshes: dict[tuple[int, int], tuple[Triangles, Any]] = {}
        self._buffers: dict[tuple[int, int], tuple[int, int]] = {}
        GL.glBindVertexArray(GL.glGenVertexArrays(1))  # a program is validated with one bound
        program = GL.glCreateProgram()
        for kind, source in (
            (GL.GL_VERTEX_SHADER, _VERTEX_SHADER),
            (GL.GL_FRAGMENT_SHADER, _FRAGMENT_SHADER),
        ):
            shader = GL.glCreateShader(kind)
            GL.glShaderSource(shader, source)
            GL.glCompileShader(shader)
            GL.glAttachShader(program, shader)
        GL.glLinkProgram(program)
        GL.glUseProgram(program)
        self._clip_from_mesh = GL.glGetUniformLocation(program, "clip_from_mesh")
        GL.glEnable(GL.GL_DEPTH_TEST)

    def make_current(self) -> None:
        """In this thread, until `release`."""
        self._egl.eglMakeCurrent(
            self._display, self._egl.EGL_NO_SURFACE, self._egl.EGL_NO_SURFACE, self._context
        )

    def release(self) -> None:
        """Leave this thread without a context."""
        self._egl.eglMakeCurrent(
            self._display,
            self._egl.EGL_NO_SURFACE,
            self._egl.EGL_NO_SURFACE,
            self._egl.EGL_NO_CONTEXT,
        )

    def render(
        self, mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox
    ) -> DepthImage:
        GL = self._gl
        z = mesh.vertices @ T_camera_mesh[2, :3] + T_camera_mesh[2, 3]
        nearest = float(z.min())
        farthest = float(z.max())
        if nearest <= NEAR:
            raise RenderFailed(
                "the fruit's pose is behind the camera or touches it: the detection is wrong"
            )
        # Tight planes: the 24 bits of the depth buffer are spent on the fruit alone.
        near = 0.98 * nearest
        far = 1.02 * farthest
        rows, columns = box.shape
        clip_from_camera = _projection(intrinsics, box, near, far)
        matrix = np.ascontiguousarray((clip_from_camera @ T_camera_mesh).T, dtype=np.float32)
        primitive = self._primitive(mesh)
        self._bind_buffer(rows, columns)
        GL.glViewport(0, 0, columns, rows)
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        GL.glUniformMatrix4fv(self._clip_from_mesh, 1, GL.GL_FALSE, matrix)
        primitive._bind()
        # Of a closed mesh, faces that look away are never seen. Rows grow downwards here, which turns the winding.
        outwards = winding(mesh)
        (GL.glEnable if outwards else GL.glDisable)(GL.GL_CULL_FACE)
        GL.glFrontFace(GL.GL_CW if outwards > 0 else GL.GL_CCW)
        GL.glDrawElements(GL.GL_TRIANGLES, 3 * len(mesh.faces), GL.GL_UNSIGNED_INT, None)
        buffer = np.empty((rows, columns), dtype=np.float32)
        GL.glReadPixels(0, 0, columns, rows, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, buffer)
        seen = buffer < 1.0
        depth: DepthImage = np.zeros((rows, columns), dtype=np.float32)
        depth[seen] = near * far / (far - buffer[seen].astype(np.float64) * (far - near))
        return depth

    def _primitive(self, mesh: Triangles) -> Any:
        """Return the mesh as pyrender uploads it; kept, since uploading costs more than rendering."""
        key = (id(mesh.vertices), id(mesh.faces))
        if key not in self._meshes:
            while len(self._meshes) >= _MESHES_KEPT:
                self._meshes.pop(next(iter(self._meshes)))[1].delete()
            primitive = self._pyrender.Primitive(
                positions=mesh.vertices.astype(np.float32),
                indices=mesh.faces.astype(np.uint32),
                mode=4,
            )
            primitive._add_to_context()
            self._meshes[key] = (
                mesh,
                primitive,
            )  # holding the mesh keeps its arrays' ids from being reused
        return self._meshes[key][1]

    def _bind_buffer(self, rows: int, columns: int) -> None:
        """Draw into a buffer that holds depth alone and is at least so large."""
        GL = self._gl
        height, width = (-(-size // _TILE) * _TILE for size in (rows, columns))
        if (height, width) not in self._buffers:
            while len(self._buffers) >= _BUFFERS_KEPT:
                framebuffer, depth = self._buffers.pop(next(iter(self._buffers)))
                GL.glDeleteFramebuffers(1, [framebuffer])
                GL.glDeleteRenderbuffers(1, [depth])
            framebuffer = int(GL.glGenFramebuffers(1))
            depth = int(GL.glGenRenderbuffers(1))
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, depth)
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, GL.GL_DEPTH_COMPONENT24, width, height)
            GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, framebuffer)
            GL.glFramebufferRenderbuffer(
                GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_RENDERBUFFER, depth
            )
            GL.glDrawBuffer(GL.GL_NONE)
            GL.glReadBuffer(GL.GL_NONE)
            self._buffers[(height, width)] = (framebuffer, depth)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffers[(height, width)][0])


def _projection(intrinsics: Intrinsics, box: ImageBox, near: float, far: float) -> Float64:
    """OpenGL's clip coordinates from the camera frame, for the pixels of a box; row 0 of the buffer is the top."""
    rows, columns = box.shape
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 2] = (
        2.0 * intrinsics.fx / columns,
        2.0 * (intrinsics.cx - box.left + 0.5) / columns - 1.0,
    )
    matrix[1, 1], matrix[1, 2] = (
        2.0 * intrinsics.fy / rows,
        2.0 * (intrinsics.cy - box.top + 0.5) / rows - 1.0,
    )
    matrix[2, 2], matrix[2, 3] = (far + near) / (far - near), -2.0 * far * near / (far - near)
    matrix[3, 2] = 1.0
    return matrix


_lock = threading.Lock()
_renderer: _GlRenderer | None = None


def render_with_gl(
    mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox
) -> DepthImage:
    """`render.DepthRenderer` by pyrender, depth (h, w) [m]; may be called from any thread.

    Raises RenderFailed: OpenGL does not work here, or a part of the mesh is not in front of the camera.
    """
    try:
        return _render(mesh, T_camera_mesh, intrinsics, box)
    except RenderFailed:
        raise
    except Exception as error:  # PyOpenGL raises many kinds; none of them is this caller's fault
        raise RenderFailed(
            f"pyrender could not render ({type(error).__name__}: {error})"
        ) from error


def _render(
    mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox
) -> DepthImage:
    global _renderer
    load_pyrender()
    from OpenGL import EGL

    with _lock:
        before = EGL.eglGetCurrentDisplay(), EGL.eglGetCurrentContext()
        surfaces = EGL.eglGetCurrentSurface(EGL.EGL_DRAW), EGL.eglGetCurrentSurface(EGL.EGL_READ)
        try:
            if _renderer is None:
                _renderer = _GlRenderer()
            _renderer.make_current()
            return _renderer.render(mesh, T_camera_mesh, intrinsics, box)
        finally:
            if before[1]:
                EGL.eglMakeCurrent(before[0], *surfaces, before[1])
            elif _renderer is not None:
                _renderer.release()


def render_with_zbuffer(
    mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox
) -> DepthImage:
    """`render.DepthRenderer` in compiled loops, depth (h, w) [m].

    Raises RenderFailed: a part of the mesh is not in front of the camera.
    """
    points = mesh.vertices @ T_camera_mesh[:3, :3].T + T_camera_mesh[:3, 3]
    if points[:, 2].min() <= NEAR:
        raise RenderFailed(
            "the fruit's pose is behind the camera or touches it: the detection is wrong"
        )
    camera = (intrinsics.fx, intrinsics.fy, intrinsics.cx - box.left, intrinsics.cy - box.top)
    nearest = np.zeros(box.shape)
    faces = np.ascontiguousarray(mesh.faces)
    u, v, nearness = project(points, camera)
    draw(u, v, nearness, faces, _seen(u, v, faces, winding(mesh)), nearest)
    depth: DepthImage = np.where(nearest > 0.0, 1.0 / np.maximum(nearest, 1e-12), 0.0).astype(
        np.float32
    )
    return depth


@kernel(nogil=True)
def _seen(u: Float64, v: Float64, faces: NDArray[np.int32], outwards: int) -> NDArray[np.bool_]:
    """Return which faces may be seen, (m,): of a closed mesh, those that look at the camera."""
    seen = np.ones(len(faces), np.bool_)
    if outwards == 0:
        return seen
    for i in range(len(faces)):
        a = faces[i, 0]
        b = faces[i, 1]
        c = faces[i, 2]
        area = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a])
        seen[i] = area * outwards < 0.0
    return seen


_AROUND = 8  # half the edge of the square in which the depth around a point is looked up [px]


@dataclass(frozen=True, slots=True, eq=False)
class DepthLook:
    """One depth image of a fruit, with its camera."""

    depth: DepthImage  # z-depth, shape (h, w) [m]; 0 or not finite where the sensor saw nothing
    intrinsics: Intrinsics  # of the depth image
    depth_model: DepthModel = D4XX  # errors of the depth, as the camera states them
    # pose of this camera in the frame of the look that is refined, shape (4, 4)
    T_camera_look: Float64 = field(default_factory=lambda: np.eye(4))
    renderer: RendererName = "pyrender"  # name of the renderer of the virtual depth

    def check(self) -> None:
        """Raise BadDepth for a depth of another shape or type, BadPose for a pose that is not rigid."""
        check_depth(self.depth, self.intrinsics)
        check_pose(self.T_camera_look)

    def distance(self, p_camera: Float64) -> float:
        """Return the measured depth around a point, shape (3,) [m]: a small fruit is nearer than its model."""
        x, y, z = p_camera
        if z <= 0.0:  # behind the camera: the rendering reports it
            return 0.0
        column = (self.intrinsics.fx * x + self.intrinsics.cx * z) / z
        row = (self.intrinsics.fy * y + self.intrinsics.cy * z) / z
        top, left = (max(round(float(at)) - _AROUND, 0) for at in (row, column))
        around = self.depth[top : top + 2 * _AROUND, left : left + 2 * _AROUND]
        seen = around[np.isfinite(around) & (around > 0.0)]
        return float(np.median(seen)) if len(seen) else float(z)

    def render(
        self, mesh: Triangles, T_look_mesh: Float64, box: ImageBox | None = None
    ) -> tuple[DepthImage, ImageBox]:
        """Render the depth of a mesh as this camera would measure it, float32, shape `box.shape` [m].

        See `render.render_depth` for the arguments, the returned box and the errors.
        """
        return render_depth(mesh, T_look_mesh, self.intrinsics, box, self.renderer)
