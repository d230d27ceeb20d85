"""Universal Robots arms as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.tools.kit.cell_piece import CellPiece

UR5E = CellPiece(
    role="arm",
    address="192.168.1.40",
    address_help="HOST of the controller",
    device="""driver: universal-robots
address: "{arm}"
model: ur5e
robot: robot.xml
""",
    simulated="include: sim.yaml#devices/arm",
    emulator="universal-robots",
    twin_address="127.0.0.1",
    workspace="sim_ur5e.yaml#workspace",
    due=("On the pendant: remote control; payload and centre of gravity of hand and camera.",),
)
