"""How a cell file's settings become the simulated world and its devices: the entry points of this package."""

from __future__ import annotations

from drivers.cell_file import Settings
from drivers.device import Bench
from drivers.errors import UnusableRobotFile
from drivers.interfaces import Intrinsics
from drivers.motion_supervisor import read_supervision
from drivers.sim.arm import SimArm
from drivers.sim.camera import SimCamera
from drivers.sim.fingers import SimFingers
from drivers.sim.gripper import SimGripper
from drivers.sim.hands import SimHands
from drivers.sim.layout import read_layout
from drivers.sim.scene import build_scene
from drivers.sim.stereo_depth import Stereo
from drivers.sim.world import SimWorld


def connect_world(settings: Settings, bench: Bench) -> SimWorld:
    """`driver: mujoco`"""
    layout = read_layout(settings, bench.seed, bench.workspace.obstacles if bench.workspace else ())
    poses = bench.workspace.poses if bench.workspace else {}
    start = settings.choice("start", poses)
    try:
        scene = build_scene(layout, bench.seed)
    except UnusableRobotFile as error:
        raise settings.error(str(error), "robot") from error
    if poses[start].size != scene.dof:
        words = f"the robot has {scene.dof} joints, the pose '{start}' has {poses[start].size}"
        raise settings.error(words, "start" if settings.has("start") else None)
    return SimWorld(scene, layout.robot, poses[start], bench.seed)


def connect_arm(settings: Settings, bench: Bench) -> SimArm:
    """`driver: sim-arm`"""
    world = _world(settings, bench)
    return SimArm(world, world.description, read_supervision(settings))


def connect_gripper(settings: Settings, bench: Bench) -> SimGripper:
    """`driver: sim-gripper`"""
    return SimGripper(
        _world(settings, bench),
        speed_max=settings.number("speed_max", "speed", 0.2, 1e-3, 1.0),
        force_max=settings.number("force_max", "force", 20.0, 1.0, 50.0),
        watchdog=settings.number("watchdog", "time", 0.1, 0.02, 1.0),
    )


def connect_fingers(settings: Settings, bench: Bench) -> SimFingers:
    """`driver: sim-fingers`"""
    return SimFingers(
        _world(settings, bench),
        noise=settings.number("noise", "force", 0.04, 0.0, 1.0),
        bias=settings.number("bias", "force", 0.08, 0.0, 2.0),
        force_range=settings.number("range", "force", 8.0, 0.5, 100.0),
    )


def connect_hands(settings: Settings, bench: Bench) -> SimHands:
    """`driver: sim-hands`"""
    return SimHands(_world(settings, bench))


def connect_camera(settings: Settings, bench: Bench) -> SimCamera:
    """`driver: sim-camera`"""
    width, height = settings.vector("size", 2)
    fx, fy = settings.vector("focal", 2)
    cx, cy = settings.vector("centre", 2)
    stereo = Stereo(
        focal=float(fx),
        baseline=settings.number("baseline", "length", 0.05, 1e-3, 0.5),
        disparity_noise=settings.number("disparity_noise", "number", 0.08, 0.0, 2.0),
        nearest=settings.number("nearest", "length", 0.18, 0.0, 1.0),
    )
    intrinsics = Intrinsics(float(fx), float(fy), float(cx), float(cy), int(width), int(height))
    return SimCamera(_world(settings, bench), intrinsics, stereo, settings.number("rate", "rate", 30.0, 1.0, 1000.0))


def _world(settings: Settings, bench: Bench) -> SimWorld:
    world = bench.find(SimWorld)
    if world is None:
        raise settings.error("a simulated device needs the simulated world above it (world: {driver: mujoco, …})")
    return world
