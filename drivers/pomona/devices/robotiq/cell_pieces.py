"""Robotiq grippers as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.tools.kit.cell_piece import CellPiece

SIMULATED = """driver: sim-gripper
speed_max: 150 mm/s
force_max: 50 N
watchdog: 100 ms
"""
PORT = "its serial port; better /dev/serial/by-id/…"
HEAVY = "Fruit that bears 40 N: the gripper presses with 20 N a finger at least."
HAND_E = CellPiece(
    role="gripper",
    address="/dev/ttyUSB0",
    address_help=PORT,
    device="""driver: robotiq           # the least force of a Hand-E is 20 N a finger: pomona run … --set force="40 N"
model: hand-e
port: "{gripper}"
finger_offset: 53 mm      # opening between the pads' faces when the gripper is closed
""",
    simulated=SIMULATED,
    emulator="hand-e",
    twin_address="/tmp/pomona/hand_e",
    due=(
        "`devices.gripper.finger_offset` in cell.yaml: opening between the pads' faces when the gripper is closed.",
        HEAVY,
    ),
    settings=("force=40 N",),
)
ROBOTIQ_2F_85 = CellPiece(
    role="gripper",
    address="/dev/ttyUSB0",
    address_help=PORT,
    device="""driver: robotiq           # the least force of a 2F-85 is 20 N a finger: pomona run … --set force="40 N"
model: 2f-85
port: "{gripper}"
finger_offset: 0 mm       # opening between the pads' faces when the gripper is closed
""",
    simulated=SIMULATED,
    emulator="2f-85",
    twin_address="/tmp/pomona/2f_85",
    due=(
        "robot.xml: its fingers slide along the line that touches the linkage's circle at 65 mm.",
        "With force fingers on its pads the twin slips and bruises: docs/reports/arms.md.",
        "Fruit of 76 mm at most between its fingertips, which open by 85 mm.",
        HEAVY,
    ),
    settings=("force=40 N", "fruit=apple_4"),
)
