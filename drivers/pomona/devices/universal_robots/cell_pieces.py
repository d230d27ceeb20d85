"""Universal Robots arms as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece

FORCE = CellPiece(
    role="load",
    device="""driver: universal-robots-force     # the arm's own force at the tool
address: "{arm}"
mass: 1.5 kg              # hand, camera and fruit
least: 4 N                # smallest lasting change that is no error; from 1 N on down Lift and Release use it, too
""",
    simulated="""driver: sim-load
mass: 1.5 kg
least: 4 N
""",
    due=(
        "`devices.load` in cell.yaml: `mass` of hand, camera and fruit; `least`, measured on your arm.",
    ),
)
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
    beside=(FORCE,),
)
