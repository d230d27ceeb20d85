"""The simulated camera: where a pixel looks, how true its depth is, and the same picture for the same seed."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import Camera, Intrinsics, Workspace
from pomona.tools.simulation.camera import _set_projection
from pomona.tools.simulation.gl import in_gl_thread, load_mujoco, open_renderer
from pomona.tools.simulation.stereo_depth import Stereo, measure_depth

D435I = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
STEREO = Stereo(focal=610.6, baseline=0.05, disparity_noise=0.08, nearest=0.18)


def test_a_ball_appears_where_the_pinhole_puts_it():
    mujoco = load_mujoco()
    centres = [(-0.1, -0.08, 0.6), (0.12, 0.05, 0.6), (0.0, 0.0, 0.5), (0.1, -0.1, 0.7)]
    balls = "".join(
        f'<geom type="sphere" size="0.008" pos="{x} {-y} {-z}"/>' for x, y, z in centres
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><visual><quality offsamples="0"/></visual><worldbody><camera name="camera" resolution="640 480" '
        f'sensorsize="0.00384 0.00288" focalpixel="500 500"/>{balls}</worldbody></mujoco>'
    )
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    _set_projection(model, 0, D435I)

    def render():
        renderer = open_renderer(model, 480, 640)
        renderer.enable_depth_rendering()
        renderer.update_scene(state, camera="camera")
        depth = renderer.render().copy()
        renderer.close()
        return depth

    depth = in_gl_thread(render)
    for x, y, z in centres:
        u, v = D435I.fx * x / z + D435I.cx, D435I.fy * y / z + D435I.cy
        top, left = int(v) - 20, int(u) - 20
        rows, columns = np.nonzero(depth[top : top + 41, left : left + 41] < 0.9)
        assert left + columns.mean() == pytest.approx(u, abs=0.12)
        assert top + rows.mean() == pytest.approx(v, abs=0.12)


def test_depth_lies_on_the_table_for_the_camera_pose_of_the_frame(open_cell):
    cell = open_cell(seed=3)
    frame = cell.device(Camera).latest()
    state = cell.devices["world"].state
    T_base_camera = np.eye(4)
    T_base_camera[:3, :3] = state.site("camera").xmat.reshape(3, 3)
    T_base_camera[:3, 3] = state.site("camera").xpos
    T_base_tool = np.eye(4)
    T_base_tool[:3, :3] = state.body("tool0").xmat.reshape(3, 3)
    T_base_tool[:3, 3] = state.body("tool0").xpos
    assert np.abs(T_base_tool @ frame.T_mount_camera - T_base_camera).max() < 1e-9
    rows, columns = np.nonzero(frame.depth[400:, 500:] > 0.0)
    z = frame.depth[400:, 500:][rows, columns]
    rays = np.column_stack(
        [(columns + 500 - 317.7) / 610.6, (rows + 400 - 238.1) / 610.6, np.ones(len(z))]
    )
    points = (rays * z[:, None]) @ T_base_camera[:3, :3].T + T_base_camera[:3, 3]
    assert np.median(points[:, 2]) == pytest.approx(-0.12, abs=3e-4)
    assert np.std(points[:, 2]) < 2e-3
    assert frame.colour.shape == (480, 640, 3)
    assert frame.depth.dtype == np.float32
    assert np.array_equal(frame.q, state.qpos[:7])


def test_depth_noise_is_that_of_a_stereo_camera():
    rng = np.random.default_rng(0)
    for z in (0.4, 0.6, 1.0):
        true = np.full((240, 320), z, np.float32)
        measured = measure_depth(true, STEREO, rng)
        seen = measured > 0.0
        assert seen.mean() > 0.99
        error = measured[seen] - z
        expected = np.hypot(
            z**2 * 0.08 / (610.6 * 0.05), 1e-3 / np.sqrt(12.0)
        )  # and steps of a millimetre
        assert error.std() == pytest.approx(expected, rel=0.1)
        assert abs(error.mean()) < 2e-4
        rows = (measured - z) * seen
        neighbours = np.corrcoef(rows[:, :-1].ravel(), rows[:, 1:].ravel())[0, 1]
        assert neighbours > 0.5


def test_depth_has_shadows_and_holes_where_a_stereo_camera_has_them():
    true = np.full((200, 300), 0.8, np.float32)
    true[60:140, 100:200] = 0.5  # a plate before a wall
    measured = measure_depth(true, STEREO, np.random.default_rng(1))
    shadow = round(610.6 * 0.05 * (1 / 0.5 - 1 / 0.8))
    assert (measured[70:130, 100 - shadow + 2 : 98] == 0.0).mean() > 0.95
    assert (measured[70:130, 204 : 204 + shadow] == 0.0).mean() < 0.05
    edge = measured[59:61, 110:190]
    assert (edge == 0.0).mean() > 0.5
    assert (measured[80:120, 120:180] > 0.0).mean() > 0.95
    assert np.all(
        measure_depth(np.full((20, 20), 0.1, np.float32), STEREO, np.random.default_rng(1)) == 0.0
    )
    assert np.all(
        measure_depth(np.zeros((20, 20), np.float32), STEREO, np.random.default_rng(1)) == 0.0
    )


def test_one_frame_a_period_and_none_newer_than_now(open_cell):
    cell = open_cell(seed=3)
    camera = cell.device(Camera)
    first = camera.latest()
    cell.clock.advance(0.01)
    assert camera.latest() is first
    cell.clock.advance(0.03)
    second = camera.latest()
    assert second.sequence == first.sequence + 1
    assert second.stamp == cell.clock.now()


def test_a_frozen_camera_keeps_its_frame_and_is_noticed(open_cell):
    cell = open_cell(seed=3)
    camera = cell.device(Camera)
    before = camera.latest()
    camera.inject_fault("freeze")
    cell.clock.advance(0.45)
    cell.check()
    assert camera.latest() is before
    cell.clock.advance(0.1)
    with pytest.raises(DeviceLost, match="no new frame"):
        cell.check()
    camera.inject_fault("lost")
    assert camera.latest() is None


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("old", "delivers frames that are 30 s old"),
        ("early", "stamps its frames 10 s in the future"),
        ("repeated", "repeats its frame 0"),
        ("depth_stale", "shows the same depth image for 0.54 s, to the last bit"),
    ],
)
@pytest.mark.parametrize("looked_before", [True, False])
def test_frames_that_are_not_current_are_reported_within_a_second_and_never_shown(
    open_cell, kind, words, looked_before
):
    cell = open_cell(seed=3)
    camera = cell.device(Camera)
    before = camera.latest() if looked_before else None
    camera.inject_fault(kind)
    for _ in range(20):
        cell.clock.advance(0.02)
        cell.check()
        assert camera.latest() is before
    cell.clock.advance(0.14)  # 0.54 s after the last frame that could be believed
    with pytest.raises(DeviceFault) as caught:
        cell.check()
    assert caught.value.message == words
    camera.clear_fault()
    cell.check()
    assert camera.latest().stamp == cell.clock.now()


@pytest.mark.parametrize("kind", ["depth_transposed", "depth_halved", "colour_halved"])
def test_images_of_different_sizes_are_a_fault_that_names_both(open_cell, kind):
    camera = open_cell(seed=3).device(Camera)
    camera.inject_fault(kind)
    for look in (camera.latest, camera.latest_depth):
        with pytest.raises(
            DeviceFault,
            match=r"camera: its images are not of one size: colour \d+ x \d+ px, intrinsics",
        ):
            look()
    camera.clear_fault()
    assert camera.latest().depth.shape == camera.latest().colour.shape[:2]


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["moved_x", "turned_y_back", "focal_long", "depth_short", "depth_mirrored"]
)
def test_a_wrong_calibration_changes_the_metadata_of_a_frame_and_not_its_colour(open_cell, kind):
    camera = open_cell(seed=3).device(Camera)
    sound = camera.latest()
    camera.inject_fault(kind)
    wrong = camera.latest()
    assert wrong.colour is sound.colour
    assert camera.latest() is wrong
    moved = np.linalg.inv(sound.T_mount_camera) @ wrong.T_mount_camera
    assert np.isclose(np.linalg.norm(moved[:3, 3]), 0.015 if kind == "moved_x" else 0.0)
    turned = np.arccos(np.clip((np.trace(moved[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    assert np.isclose(np.degrees(turned), 3.0 if kind == "turned_y_back" else 0.0, atol=1e-6)
    assert np.isclose(
        wrong.intrinsics.fx / sound.intrinsics.fx, 1.05 if kind == "focal_long" else 1.0
    )
    assert np.array_equal(wrong.depth, sound.depth) == (not kind.startswith("depth"))


def test_depth_of_the_frame_before_follows_one_frame_behind(open_cell):
    cell = open_cell(seed=3)
    camera = cell.device(Camera)
    camera.inject_fault("depth_late")
    first = camera.latest()
    cell.clock.advance(0.04)
    camera.latest()
    own = camera._frame
    cell.clock.advance(0.04)
    assert np.array_equal(camera.latest().depth, own.depth)
    assert not np.array_equal(own.depth, first.depth)


@pytest.mark.parametrize("pose", ["observe", "observe_2", "observe_3"])
def test_every_observe_pose_sees_all_places_whole(open_cell, pose):
    """Cuboids of the largest apple at each place lie in the image, far from its border; the robot is not in it."""
    cell = open_cell(seed=1, others="4")
    state = cell.devices["world"].state
    state.qpos[:7] = cell.device(Workspace).poses[pose]
    mujoco = load_mujoco()
    mujoco.mj_forward(cell.devices["world"].model, state)
    site = state.site("camera")
    R, p = site.xmat.reshape(3, 3), site.xpos
    corners = np.array(
        [[x, y, z] for x in (-0.047, 0.047) for y in (-0.047, 0.047) for z in (-0.12, -0.035)]
    )
    for place in ((-0.12, -0.35), (0.08, -0.34), (-0.03, -0.52), (0.15, -0.48), (-0.20, -0.48)):
        seen = (corners + np.array([*place, 0.0]) - p) @ R
        u = D435I.fx * seen[:, 0] / seen[:, 2] + D435I.cx
        v = D435I.fy * seen[:, 1] / seen[:, 2] + D435I.cy
        assert u.min() > 30
        assert u.max() < 610
        assert v.min() > 30
        assert v.max() < 450
    depth = cell.device(Camera).latest().depth
    assert depth[depth > 0.0].min() > 0.4
    assert not [
        c
        for c in state.contact
        if {c.geom1, c.geom2} & set(robot_geoms(cell.devices["world"].model))
    ]


def robot_geoms(model):
    return [i for i in range(model.ngeom) if model.geom_contype[i] == 2]


def test_asking_when_the_camera_was_heard_takes_no_picture(open_cell):
    cell = open_cell(seed=1)
    camera = cell.device(Camera)
    looked = []
    camera._world.looked = lambda: looked.append(cell.clock.now())
    cell.clock.advance(0.2)
    assert cell.last_seen()["camera"] == cell.clock.now()
    assert looked == []
    camera.latest()
    assert looked == [cell.clock.now()]
    camera.inject_fault("lost")
    cell.clock.advance(0.2)
    assert cell.last_seen()["camera"] < cell.clock.now()


def test_viewers_see_the_world_while_they_ask_and_no_look_changes(open_cell, monkeypatch):
    monkeypatch.setattr("pomona.tools.simulation.camera.SHOWN", 0.0)
    asked, alone = open_cell(seed=3), open_cell(seed=3)
    camera = asked.device(Camera)
    asked.check()
    assert asked.pictures() == {}  # nobody has asked, nothing was rendered
    for _ in range(3):
        asked.pictures()
        for cell in (asked, alone):
            cell.clock.advance(0.1)
            cell.check()
    picture, stamp = asked.pictures()["camera"]
    assert picture.shape == (240, 320, 3)
    assert picture.std() > 5.0
    assert stamp == asked.clock.now()
    assert np.array_equal(camera.latest().colour, alone.device(Camera).latest().colour)
    assert np.array_equal(camera.latest().depth, alone.device(Camera).latest().depth)
    camera.inject_fault("lost")
    asked.clock.advance(1.0)
    with pytest.raises(DeviceLost):
        asked.check()
    assert asked.pictures()["camera"][1] == stamp  # what a lost camera sees is not shown
