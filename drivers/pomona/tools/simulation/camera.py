"""The simulated RGB-D camera, on the gripper or fixed in the cell: pictures are rendered on request and come later."""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.camera_options import scaled
from pomona.drivers.errors import DeviceError, DeviceLost
from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.drivers.streams import FrameGuard
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.later import Later
from pomona.tools.simulation.exposure import Moments, Timing
from pomona.tools.simulation.gl import in_gl_thread, load_mujoco, open_renderer
from pomona.tools.simulation.stereo_depth import CHANGES, FrameChanger, Stereo, measure_depth
from pomona.tools.simulation.world import FaultyDevice, PhysicsWorld

cv2: Any = Later("cv2")


class Delivery:
    """Frames on their way from a camera; a frame is exposed when one is asked for.

    After a time without a request nothing is on its way, and the first frame is delivered at once.
    """

    def __init__(self, clock: Clock, latency: tuple[float, float], seed: int) -> None:
        """
        Args:
            latency: least and largest time from an exposure to its delivery [s].
        """
        self._clock = clock
        self._latency = latency
        self._seed = seed
        self._coming: deque[tuple[float, Frame]] = deque()
        self._delivered: Frame | None = None

    def newest(self, exposed: Frame | None) -> Frame | None:
        """Take the frame of this moment, and return the newest one that has arrived."""
        if exposed is None or self._latency[1] == 0.0:
            return exposed
        now = self._clock.now()
        waits = 2.0 * self._latency[1]
        if self._delivered is None or now - self._delivered.stamp > waits + self._latency[1]:
            self._coming.clear()
            self._delivered = exposed
            return exposed
        if exposed.sequence != (self._coming[-1][1] if self._coming else self._delivered).sequence:
            drawn = np.random.default_rng([self._seed, 19, exposed.sequence]).uniform(
                *self._latency
            )
            before = self._coming[-1][0] if self._coming else 0.0
            self._coming.append((max(now + float(drawn), before), exposed))  # in order
        while self._coming and self._coming[0][0] <= now + 1e-9:
            self._delivered = self._coming.popleft()[1]
        return self._delivered


# time without a valid or new frame after which the camera is lost [s]; as for a real one
SILENCE = 0.5
LIES = {"old": -30.0, "early": 10.0, "repeated": 0.0, "depth_stale": 0.0}
"""Faults of a camera that goes on sending, and by how much its stamps are wrong [s]."""

# shortest time between pictures for viewers, and rendering time after a request [s]
SHOWN = 1.0
ASKED = 2.0
SILENT = ("freeze", "lost")  # faults of a camera that sends nothing new


class SimCamera(FaultyDevice):
    """Renders the present state of the world, at most once per frame period. Depth is registered to colour.

    Faults: `freeze` (the newest frame stays the same), `lost` (no frame), frames that are `old`, `early` (of the
    future) or `repeated` (with the number of the one before), `depth_stale` (new colour with the same depth), and those
    of `camera_faults.CHANGES`.
    """

    interfaces = (Camera,)
    known_faults = ("freeze", "lost", *LIES, *CHANGES)

    def __init__(
        self,
        world: PhysicsWorld,
        intrinsics: Intrinsics,
        stereo: Stereo,
        rate: float,
        T_base_camera: Float64 | None = None,
        timing: Timing | None = None,
        T_mount_stated: Float64 | None = None,
    ) -> None:
        """
        Args:
            T_base_camera: where the camera is fixed in the cell, shape (4, 4); without it, it rides on the gripper.
            timing: when frames are exposed and delivered; by default all in the moment in which one is asked for.
            T_mount_stated: pose in its mount that the frames state, shape (4, 4); without it, the true one.
        """
        super().__init__("camera")
        self._world = world
        self._intrinsics = intrinsics
        self._stereo = stereo
        self._rate = rate
        model = world.model
        self._fixed = T_base_camera is not None
        if T_base_camera is None:
            model.cam_resolution[model.cam("camera").id] = (intrinsics.width, intrinsics.height)
            _set_projection(model, model.cam("camera").id, intrinsics)
        self._joints = model.jnt_qposadr[world.arm_joints]
        self.T_mount_camera = _pose_in_flange(model) if T_base_camera is None else T_base_camera
        self._stated = self.T_mount_camera if T_mount_stated is None else T_mount_stated
        self._renderer: Any = None
        self._depth_renderer: Any = None
        self._frame: Frame | None = None
        self._watched: Frame | None = None
        self._changer = FrameChanger()
        self._timing = Timing() if timing is None else timing
        self._moments = Moments(model)
        self._pictures, self._depths = (
            Delivery(world.clock, self._timing.latency, world.seed) for _ in range(2)
        )
        self._fault_since = 0.0
        self._judged = 0
        self._guard = FrameGuard(world.clock, SILENCE)
        self._asked = self._shown = -math.inf
        self._picture: tuple[UInt8, float] | None = None

    def latest(self) -> Frame | None:
        """Return the view of this moment, less the latency. Two calls within one frame period get the same frame."""
        return self._changer.delivered(self._pictures.newest(self._newest()))

    def _newest(self) -> Frame | None:
        if self.fault == "lost":
            return None
        stamp, sequence = self._next()
        if self.fault == "freeze" or (self._frame is not None and self._frame.sequence == sequence):
            return self._frame
        if self._judge():
            self._world.looked()
            self._frame = self._expose(stamp, sequence)
        return self._frame

    def latest_depth(self) -> Frame | None:
        """Return the depth as `latest` does, with half the pixels each way; not a look that is scored."""
        return self._changer.delivered(self._depths.newest(self._newest_depth()))

    def _newest_depth(self) -> Frame | None:
        if self.fault is not None and self.fault not in CHANGES:
            return None if self.fault == "lost" else self._watched
        stamp, sequence = self._next()
        if self._watched is None or self._watched.sequence != sequence:
            half = scaled(
                self._intrinsics, self._intrinsics.width // 2, self._intrinsics.height // 2
            )
            depth = in_gl_thread(lambda: self._render_depth(half))
            rng = np.random.default_rng([self._world.seed, 14, sequence])
            stereo = replace(
                self._stereo, focal=half.fx, disparity_noise=self._stereo.disparity_noise / 2.0
            )
            colour = np.broadcast_to(np.uint8(0), (half.height, half.width, 3))
            self._watched = self._frame_of(
                stamp, sequence, colour, measure_depth(depth, stereo, rng), half, stereo
            )
        return self._watched

    def _next(self) -> tuple[float, int]:
        """Stamp and number of the frame of this moment."""
        now = self._world.clock.now()
        sequence = int(now * self._rate + 1e-6)
        if self.fault == "repeated":
            return now, self._frame.sequence if self._frame is not None else 0
        return now + LIES.get(self.fault or "", 0.0), sequence

    def _judge(self) -> bool:
        """Judge the frame of this moment without taking it: a picture is a look that is scored."""
        stamp, sequence = self._next()
        depth = b"stale" if self.fault == "depth_stale" else b""
        self._judged += 1
        return self._guard.judge(stamp, sequence, str(self._judged).encode(), depth)

    def last_seen(self) -> float | None:
        """Every moment has its view, and asking for its stamp takes no picture: a picture is a look that is scored."""
        if self.fault is None or self.fault in CHANGES:
            return self._world.clock.now()
        return None if self._frame is None else self._frame.stamp

    def picture(self) -> tuple[UInt8, float] | None:
        """Return an image (h, w, 3) of at most a second ago, once one was requested before. From any thread."""
        self._asked = time.monotonic()
        return self._picture

    def _take_picture(self) -> None:
        """Render for viewers in the tick's thread, since no other may read the world; never a look that is scored."""
        now = time.monotonic()
        if now - self._asked < ASKED and now - self._shown >= SHOWN:
            self._picture = (
                in_gl_thread(self._render_colour)[::2, ::2].copy(),
                self._world.clock.now(),
            )
            self._shown = time.monotonic()

    def check(self) -> None:
        try:
            self._look_after()
        except DeviceError as error:
            self._problem = self._problem or error
        super().check()

    def acknowledge(self) -> None:
        self._problem = None
        self.check()

    def _look_after(self) -> None:
        if self.fault is None:
            self._take_picture()
        if self.fault in LIES:
            self._judge()
            self._guard.check(self.name)
        elif self.fault in SILENT and self._world.clock.now() - self._fault_since > SILENCE:
            raise DeviceLost(
                self.name, f"no new frame for {self._world.clock.now() - self._fault_since:.1f} s"
            )

    def inject_fault(self, kind: str) -> None:
        before = () if kind not in CHANGES else (self._expose(*self._next()), self._newest_depth())
        super().inject_fault(kind)
        if before:
            self._changer.begin(kind, tuple(frame for frame in before if frame is not None))
            return
        self._guard.restart()
        if self._frame is not None or kind == "depth_stale":
            newest = (
                self._next() if self._frame is None else (self._frame.stamp, self._frame.sequence)
            )
            self._guard.judge(*newest, depth=b"stale")
        self._fault_since = self._world.clock.now()

    def clear_fault(self) -> None:
        super().clear_fault()
        self._changer.end()

    def close(self) -> None:
        for renderer in (self._renderer, self._depth_renderer):
            if renderer is not None:
                in_gl_thread(renderer.close)
        self._renderer = self._depth_renderer = None

    def _expose(self, now: float, sequence: int) -> Frame:
        colour, depth = in_gl_thread(self._render)
        rng = np.random.default_rng([self._world.seed, 4, sequence])
        photograph = _photograph(colour, rng)
        measured = measure_depth(depth, self._stereo, rng)
        return self._frame_of(now, sequence, photograph, measured, self._intrinsics, self._stereo)

    def _frame_of(
        self,
        stamp: float,
        sequence: int,
        colour: NDArray[np.uint8],
        depth: NDArray[np.float32],
        intrinsics: Intrinsics,
        stereo: Stereo,
    ) -> Frame:
        return Frame(
            stamp=stamp,
            sequence=sequence,
            colour=colour,
            depth=depth,
            intrinsics=intrinsics,
            q=None if self._fixed else self._world.state.qpos[self._joints].copy(),
            T_mount_camera=self._stated,
            label=self.name,
            depth_model=stereo.depth_model(),
        )

    def _render(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Ideal colour of the exposure and z-depth [m]; the far plane counts as nothing seen."""
        pictures = [self._render_colour(dt) for dt in self._timing.colour]
        colour = pictures[0] if len(pictures) == 1 else np.mean(pictures, axis=0).astype(np.uint8)
        renderer = self._open_renderer()
        renderer.enable_depth_rendering()
        self._aim(renderer, self._intrinsics, self._timing.depth_after)
        depth = renderer.render().copy()
        depth[depth > 5.0] = 0.0
        return colour, depth

    def _render_colour(self, dt: float = 0.0) -> NDArray[np.uint8]:
        renderer = self._open_renderer()
        renderer.disable_depth_rendering()
        self._aim(renderer, self._intrinsics, dt)
        colour: NDArray[np.uint8] = renderer.render().copy()
        return colour

    def _render_depth(self, intrinsics: Intrinsics) -> NDArray[np.float32]:
        """Ideal z-depth [m] of an image of another size; 0 where nothing is near."""
        if self._depth_renderer is None:
            self._depth_renderer = open_renderer(
                self._world.model, intrinsics.height, intrinsics.width
            )
            self._depth_renderer.enable_depth_rendering()
        self._aim(self._depth_renderer, intrinsics, self._timing.depth_after)
        depth: NDArray[np.float32] = self._depth_renderer.render().copy()
        depth[depth > 5.0] = 0.0
        return depth

    def _aim(self, renderer: Any, intrinsics: Intrinsics, dt: float) -> None:
        """Show the world as it is `dt` from now [s], from where the camera is."""
        state = self._world.state if dt == 0.0 else self._moments.moved(self._world.state, dt)
        if not self._fixed:
            renderer.update_scene(state, camera="camera")
            return
        renderer.update_scene(state)
        model = self._world.model
        T = self.T_mount_camera
        near = float(model.vis.map.znear * model.stat.extent)
        left, right = (
            near * (u - intrinsics.cx) / intrinsics.fx for u in (-0.5, intrinsics.width - 0.5)
        )
        top, bottom = (
            near * (intrinsics.cy - v) / intrinsics.fy for v in (-0.5, intrinsics.height - 0.5)
        )
        for eye in renderer.scene.camera:
            eye.pos = T[:3, 3]
            eye.forward = T[:3, 2]
            eye.up = -T[:3, 1]
            eye.frustum_center = (left + right) / 2.0
            eye.frustum_width = (right - left) / 2.0
            eye.frustum_bottom = bottom
            eye.frustum_top = top
            eye.frustum_near, eye.frustum_far = near, float(model.vis.map.zfar * model.stat.extent)

    def _open_renderer(self) -> Any:
        if self._renderer is None:
            self._renderer = open_renderer(
                self._world.model, self._intrinsics.height, self._intrinsics.width
            )
        return self._renderer


def _photograph(ideal: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Lens blur, exposure, white balance, and noise that grows with brightness."""
    colour = cv2.GaussianBlur(ideal, (0, 0), 0.6).astype(np.float32)
    colour *= np.float32(rng.uniform(0.93, 1.07)) * rng.normal(1.0, 0.012, 3).astype(np.float32)
    noise = rng.standard_normal(colour.shape, dtype=np.float32)
    colour += noise * (np.float32(1.2) + np.float32(0.12) * np.sqrt(np.maximum(colour, 0.0)))
    taken: NDArray[np.uint8] = np.clip(colour + 0.5, 0.0, 255.0).astype(np.uint8)
    return taken


def _set_projection(model: Any, camera: int, intrinsics: Intrinsics) -> None:
    """The engine's frustum for our pinhole: it measures from the image's edge, we from the first pixel's centre."""
    size = np.array([intrinsics.width, intrinsics.height])
    pixel = model.cam_sensorsize[camera] / size
    model.cam_intrinsic[camera] = [
        intrinsics.fx * pixel[0],
        intrinsics.fy * pixel[1],
        ((size[0] - 1) / 2.0 - intrinsics.cx) * pixel[0],
        ((size[1] - 1) / 2.0 - intrinsics.cy) * pixel[1],
    ]


def _pose_in_flange(model: Any) -> Float64:
    """T_tool0_camera, from the robot's sites."""
    site = model.site("camera")
    rotation = np.zeros(9)
    T = np.eye(4)
    load_mujoco().mju_quat2Mat(rotation, site.quat)
    T[:3, :3], T[:3, 3] = rotation.reshape(3, 3), site.pos
    return T
