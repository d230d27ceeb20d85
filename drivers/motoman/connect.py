"""The driver `motoman` of a cell file."""

from __future__ import annotations

from drivers.cell_file import Settings
from drivers.device import Bench
from drivers.errors import DeviceLost, UnusableRobotFile
from drivers.motion_supervisor import read_supervision
from drivers.motoman.codec import Order
from drivers.motoman.driver import MotomanArm, MotomanOptions
from drivers.motoman.limits import read_limits
from drivers.wire import TcpLink, read_address

MOTION_PORT = 50240
"""The state's port is the next one."""
ORDERS: dict[str, Order] = {"fs100": ">", "dx100": "<", "dx200": "<", "yrc1000": "<"}
JOINTS = "S L E U R B T"


def connect(settings: Settings, bench: Bench) -> MotomanArm:
    """Open the arm that a cell file describes; the servos come on, the arm stands still.

    arm:
      driver: motoman
      address: 192.168.1.31             # or HOST:PORT of the motion connection; the state's port is the next
      controller: fs100                 # fs100, dx100, dx200 or yrc1000: the byte order
      robot: ../robots/sia5f_wsg32.xml  # the robot's description, with its limits
      joints: S L E U R B T             # the description's joints, by their names on the controller
      servo_on: true                    # switch the servos on when the run starts
      lead: 150 ms                      # how far ahead of the arm points are sent
      silence: 90 ms                    # no feedback for so long: the arm is lost
      supervision: {following_error: 0.08 rad, lag: 200 ms, margin: 2 s, stall: 500 ms, status: 250 ms}
    """
    host, port = read_address(settings, "address", MOTION_PORT)
    order = ORDERS[settings.choice("controller", ORDERS)]
    robot = settings.file("robot")
    names = settings.text("joints", JOINTS).split()
    on_wire = JOINTS.split() if len(names) == 7 else ["S", "L", "U", "R", "B", "T"]
    if sorted(names) != sorted(on_wire):
        raise settings.error(f"'joints' must name each of {' '.join(on_wire)} once", "joints")
    try:
        limits = read_limits(robot, len(names))
    except UnusableRobotFile as error:
        raise settings.error(str(error), "robot") from error
    options = MotomanOptions(
        order=order,
        group=settings.integer("group", 0, 0, 3),
        wire_joints=tuple(on_wire.index(name) for name in names),
        servo_on=settings.boolean("servo_on", True),
        point_period=settings.number("point_period", "time", 0.02, 0.008, 0.2),
        lead=settings.number("lead", "time", 0.15, 0.03, 0.7),
        silence=settings.number("silence", "time", 0.09, 0.03, 1.0),
        supervision=read_supervision(settings),
    )
    arm = MotomanArm(lambda: TcpLink(host, port + 1), lambda: TcpLink(host, port), bench.clock, robot, limits, options)
    try:
        arm.connect()
    except DeviceLost as error:
        hint = f"is the controller on, and does MotoROS listen on {host}:{port} and {port + 1}?"
        raise settings.error(error.message, "address", hint) from error
    arm.start()
    return arm
