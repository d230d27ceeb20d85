"""Weiss WSG grippers as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece

WSG32 = CellPiece(
    role="gripper",
    address="192.168.1.20:1000",
    address_help="HOST:PORT of the gripper, with its binary commands",
    device="""driver: wsg
tcp: "{gripper}"          # or can: {interface: socketcan, channel: can0, bitrate: 500000, reply_id: 2}
finger_offset: 35 mm      # opening between the pads' faces when the jaws are closed
speed_max: 200 mm/s
force_limit: 20 N
""",
    simulated="include: sim.yaml#devices/gripper",
    emulator="wsg",
    twin_address="127.0.0.1:41000",
    due=(
        "The finger script velocity.lua on the gripper, for streamed speeds.",
        "`devices.gripper.finger_offset` in cell.yaml: opening between the pads' faces when the jaws are closed.",
    ),
)
