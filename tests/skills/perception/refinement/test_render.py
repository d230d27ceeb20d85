"""Virtual depth: both renderers against exact geometry, against each other, and beside MuJoCo in one process."""

from __future__ import annotations

import subprocess
import sys
import threading

import numpy as np
import pytest
import trimesh

from pomona.skills.geometry import rot_x, rot_y, transform
from pomona.skills.perception.refinement.errors import RenderFailed
from pomona.skills.perception.refinement.render import ImageBox, image_box, render_depth, renderer
from tests.skills.perception.refinement.plain_pyrender import render_with_plain_pyrender

RENDERERS = ("pyrender", "zbuffer")


@pytest.mark.parametrize("using", RENDERERS)
def test_depth_is_z_at_pixel_centres(camera, using):
    """A tilted plate: its z-depth through a pixel is known in closed form."""
    plate = trimesh.creation.box((0.3, 0.2, 1e-3))
    T = transform(rot_x(0.5) @ rot_y(-0.3), (0.02, -0.01, 0.6))
    depth, box = render_depth(plate, T, camera, using=using)
    normal = T[:3, 2]
    front = T[:3, 3] - 0.5e-3 * normal * np.sign(normal[2])
    v, u = np.nonzero(depth)
    rays = np.column_stack(
        [
            (u + box.left - camera.cx) / camera.fx,
            (v + box.top - camera.cy) / camera.fy,
            1.0 + 0.0 * u,
        ]
    )
    expected = (front @ normal) / (rays @ normal)
    on_front = np.abs(depth[v, u] - expected) < 5e-6
    assert on_front.mean() > 0.99  # the others are on the plate's thin edges


@pytest.mark.parametrize("using", RENDERERS)
def test_ball_covers_the_pixels_whose_rays_hit_it(camera, using):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    centre = np.array([0.05, 0.04, 0.6])
    depth, box = render_depth(ball, transform(translation=centre), camera, using=using)
    v, u = np.indices(box.shape)
    rays = np.stack(
        [
            (u + box.left - camera.cx) / camera.fx,
            (v + box.top - camera.cy) / camera.fy,
            np.ones(box.shape),
        ],
        -1,
    )
    along = rays @ centre / np.sum(rays**2, axis=-1)
    miss = np.linalg.norm(along[..., None] * rays - centre, axis=-1)
    assert (depth > 0)[miss < 0.0499].all()
    assert not (depth > 0)[miss > 0.0501].any()


def test_renderers_agree(apple, camera):
    for angle in np.linspace(0.0, 3.0, 7):
        T = transform(rot_x(angle) @ rot_y(2.0 * angle), (0.08, -0.05, 0.5))
        one, box = render_depth(apple, T, camera, using="pyrender")
        other, same_box = render_depth(apple, T, camera, using="zbuffer")
        assert box == same_box
        both = (one > 0) & (other > 0)
        assert np.count_nonzero((one > 0) != (other > 0)) <= 3
        assert np.quantile(np.abs(one - other)[both], 0.99) < 1e-6


def test_the_picture_is_pyrenders_own(apple, camera):
    for angle in np.linspace(0.0, 3.0, 7):
        T = transform(rot_x(angle) @ rot_y(2.0 * angle), (0.08, -0.05, 0.5))
        depth, box = render_depth(apple, T, camera)
        expected = render_with_plain_pyrender(apple, T, camera, box)
        both = (depth > 0) & (expected > 0)
        assert np.count_nonzero((depth > 0) != (expected > 0)) <= 3
        assert np.quantile(np.abs(depth - expected)[both], 0.99) < 1e-6


@pytest.mark.parametrize("using", RENDERERS)
def test_winding_does_not_matter(apple, camera, using):
    """Neither of a closed mesh turned inside out, nor of an open one seen from behind."""
    T = transform(rot_x(0.4), (0.0, 0.0, 0.5))
    outwards, _ = render_depth(apple, T, camera, using=using)
    inwards, _ = render_depth(
        trimesh.Trimesh(apple.vertices, apple.faces[:, ::-1], process=False), T, camera, using=using
    )
    np.testing.assert_allclose(inwards, outwards, atol=1e-6)
    corners = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
    sheet = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
    seen = [
        render_depth(sheet, transform(rot_x(turn), (0.0, 0.0, 0.5)), camera, using=using)[0]
        for turn in (0.0, np.pi)
    ]
    assert np.count_nonzero(seen[0]) > 10_000
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-6)


@pytest.mark.parametrize("using", RENDERERS)
def test_box_is_cut_out_of_the_whole_image(apple, camera, using):
    T = transform(rot_x(1.0), (-0.1, 0.05, 0.5))
    part, box = render_depth(apple, T, camera, using=using)
    whole, _ = render_depth(
        apple, T, camera, ImageBox(0, 0, camera.width, camera.height), using=using
    )
    np.testing.assert_allclose(whole[box.slices], part, atol=3e-6)
    assert np.count_nonzero(whole) == np.count_nonzero(part)


@pytest.mark.parametrize("using", RENDERERS)
def test_model_at_the_image_border_is_cut(apple, camera, using):
    T = transform(rot_x(1.0), (-0.31, 0.0, 0.6))
    depth, box = render_depth(apple, T, camera, using=using)
    assert box.left == 0
    assert (depth[:, 0] > 0).any()


@pytest.mark.parametrize("using", RENDERERS)
def test_stretched_model(apple, camera, using):
    T = transform(rot_x(0.7), (0.0, 0.0, 0.6))
    T[:3, :3] *= np.array([0.8, 1.2, 0.9])
    depth, _ = render_depth(apple, T, camera, using=using)
    stretched = trimesh.Trimesh(
        apple.vertices * np.array([0.8, 1.2, 0.9]), apple.faces, process=False
    )
    expected, _ = render_depth(
        stretched, transform(rot_x(0.7), (0.0, 0.0, 0.6)), camera, using=using
    )
    np.testing.assert_allclose(depth, expected, atol=1e-6)


@pytest.mark.parametrize("using", RENDERERS)
def test_a_mesh_behind_the_camera_is_refused(apple, camera, using):
    whole = ImageBox(0, 0, camera.width, camera.height)
    for z in (-0.5, 0.0, 0.03):
        with pytest.raises(RenderFailed, match="behind"):
            renderer(using)(apple, transform(translation=(0.0, 0.0, z)), camera, whole)
    with pytest.raises(RenderFailed, match="outside the image"):
        image_box(apple, transform(translation=(2.0, 0.0, 0.5)), camera)


def test_unknown_renderer_is_named(apple, camera):
    with pytest.raises(RenderFailed, match="'povray'"):
        render_depth(apple, transform(translation=(0.0, 0.0, 0.5)), camera, using="povray")


def test_any_thread_may_render(apple, camera):
    T = transform(translation=(0.0, 0.0, 0.5))
    expected, _ = render_depth(apple, T, camera)
    seen = []
    threads = [
        threading.Thread(target=lambda: seen.append(render_depth(apple, T, camera)[0]))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20.0)
    assert len(seen) == 4
    assert all(np.array_equal(depth, expected) for depth in seen)


@pytest.mark.slow
def test_context_of_the_callers_thread_stays_current():
    program = """
import numpy as np, trimesh
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import transform
from pomona.skills.perception.refinement.render import load_pyrender
from pomona.skills.perception.refinement.render import render_depth

other = load_pyrender().OffscreenRenderer(64, 64)
from OpenGL import EGL, GL
before = EGL.eglGetCurrentContext().address
GL.glViewport(0, 0, 64, 64)
ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
camera = Intrinsics(600.0, 600.0, 320.0, 240.0, 640, 480)
for _ in range(3):
    depth, _ = render_depth(ball, transform(translation=(0.0, 0.0, 0.5)), camera)
    assert abs(depth[depth > 0].min() - 0.45) < 1e-3
    assert EGL.eglGetCurrentContext().address == before
    assert list(GL.glGetIntegerv(GL.GL_VIEWPORT)) == [0, 0, 64, 64]
print("still current")
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.strip() == "still current", done.stderr[-2000:]


def test_more_sizes_than_buffers_are_kept(camera):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    whole, _ = render_depth(
        ball, transform(translation=(0.0, 0.0, 0.5)), camera, ImageBox(0, 0, 640, 480)
    )
    for _ in range(2):
        for size in range(40, 440, 40):
            box = ImageBox(320 - size // 2, 240 - size // 2, 320 + size // 2, 240 + size // 2)
            depth, _ = render_depth(ball, transform(translation=(0.0, 0.0, 0.5)), camera, box)
            np.testing.assert_allclose(depth, whole[box.slices], atol=3e-6)


def test_more_meshes_than_are_kept(camera):
    T = transform(translation=(0.0, 0.0, 0.5))
    for radius in np.linspace(0.02, 0.05, 12):
        ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
        depth, _ = render_depth(ball, T, camera)
        assert depth[depth > 0].min() == pytest.approx(0.5 - radius, abs=1e-3)


_BESIDE_MUJOCO = """
import numpy as np
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import transform
from pomona.skills.perception.refinement.render import render_depth

def with_pyrender():
    import trimesh
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    camera = Intrinsics(600.0, 600.0, 320.0, 240.0, 640, 480)
    depth, _ = render_depth(ball, transform(translation=(0.0, 0.0, 0.5)), camera)
    assert abs(depth[depth > 0].min() - 0.45) < 1e-3

def with_mujoco():
    global model, state, viewer
    from pomona.tools.simulation.gl import in_gl_thread, load_mujoco, open_renderer
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><light pos='0 0 3'/><camera name='c' pos='0 0 1'/>"
        "<geom type='sphere' size='.1'/></worldbody></mujoco>")
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    def look():
        viewer = open_renderer(model, 120, 160)
        viewer.enable_depth_rendering()
        viewer.update_scene(state, camera="c")
        depth = viewer.render().copy()
        viewer.close()
        return depth
    depth = in_gl_thread(look)
    assert abs(depth.min() - 0.9) < 1e-3, depth.min()

for step in ORDER:
    step()
print("both work")
"""


@pytest.mark.slow
@pytest.mark.parametrize("order", ["with_pyrender, with_mujoco", "with_mujoco, with_pyrender"])
def test_lives_beside_mujoco_in_either_order(order):
    program = _BESIDE_MUJOCO.replace("ORDER", f"[{order}, {order}]")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.strip() == "both work", done.stderr[-2000:]
    assert done.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "says"),
    [
        ("pyrender", "import of pyrender halted"),
        ("OpenGL", "pyrender cannot be imported"),
        ("context", "no display"),
    ],
)
def test_a_renderer_that_does_not_import_or_open_is_replaced(hidden: str, says: str) -> None:
    """In a process of its own: libraries that were imported before stay."""
    hide = {
        "context": "import pomona.skills.perception.refinement.render as gl\n"
        "def refuse(self): raise OSError('no display')\n"
        "gl._GlRenderer.__init__ = refuse\n",
    }.get(hidden, f"import sys\nsys.modules[{hidden!r}] = None\n")
    code = hide + (
        "from pomona.skills.perception.refinement.render import usable_renderer\n"
        "print(*usable_renderer('pyrender'), sep=': ')\n"
        "print(*usable_renderer('zbuffer'))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    said, plain = done.stdout.splitlines()
    assert said.startswith("zbuffer: virtual depth comes from the z-buffer: pyrender")
    assert says in said
    assert plain.strip() == "zbuffer"
