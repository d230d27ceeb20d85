"""Yaskawa arms as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece

SIA5F = CellPiece(
    role="arm",
    address="192.168.1.31",
    address_help="HOST of the controller, which runs MotoROS",
    device="""driver: motoman
address: "{arm}"
controller: fs100         # fs100, dx100, dx200 or yrc1000
robot: robot.xml
joints: S L E U R B T     # the description's joints, by their names on the controller
lead: 250 ms              # how far ahead of the arm points are sent
supervision: {lag: 200 ms}   # of the network and the controller's servos
""",
    simulated="include: sim.yaml#devices/arm",
    emulator="fs100",
    twin_address="127.0.0.1:50240",
    workspace="sim.yaml#workspace",
    due=(
        "`devices.arm.supervision.lag` in cell.yaml: delay of the network and the controller's servos.",
    ),
)
