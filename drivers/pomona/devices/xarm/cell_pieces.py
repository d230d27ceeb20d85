"""UFACTORY arms as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece

XARM6 = CellPiece(
    role="arm",
    address="192.168.1.40",
    address_help="HOST of the controller",
    device="""driver: xarm
address: "{arm}"
model: xarm6
robot: robot.xml
""",
    simulated="include: sim.yaml#devices/arm",
    emulator="xarm",
    twin_address="127.0.0.1",
    workspace="sim_xarm6_hand_e.yaml#workspace",
    due=(
        "In UFACTORY Studio: payload and centre of gravity of hand and camera.",
        "`devices.arm.servo_lag` in cell.yaml: delay of servo mode behind set-points.",
    ),
)
