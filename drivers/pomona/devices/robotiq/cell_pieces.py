"""Robotiq grippers as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.tools.kit.cell_piece import CellPiece

HAND_E = CellPiece(
    role="gripper",
    address="/dev/ttyUSB0",
    address_help="its serial port; better /dev/serial/by-id/…",
    device="""driver: robotiq           # the least force of a Hand-E is 20 N a finger: pomona run … --set force="40 N"
model: hand-e
port: "{gripper}"
finger_offset: 53 mm      # opening between the pads' faces when the gripper is closed
""",
    simulated="""driver: sim-gripper
speed_max: 150 mm/s
force_max: 50 N
watchdog: 100 ms
""",
    emulator="hand-e",
    twin_address="/tmp/pomona/hand_e",
    due=(
        "`devices.gripper.finger_offset` in cell.yaml: opening between the pads' faces when the gripper is closed.",
        "Fruit that bears 40 N: the gripper presses with 20 N a finger at least.",
    ),
    settings=("force=40 N",),
)
