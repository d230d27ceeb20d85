"""Robotiq grippers as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece


def _piece(
    model: str, offset: str, due: tuple[str, ...], settings: tuple[str, ...] = ()
) -> CellPiece:
    """Return a gripper on a serial line; `offset` is the opening between its pads when it is closed."""
    force = '--set force="40 N"'
    return CellPiece(
        role="gripper",
        address="/dev/ttyUSB0",
        address_help="its serial port; better /dev/serial/by-id/…",
        device=f"""driver: robotiq           # its least force is 20 N a finger: pomona run … {force}
model: {model}
port: "{{gripper}}"
finger_offset: {offset:<10} # opening between the pads' faces when the gripper is closed
""",
        simulated="""driver: sim-gripper
speed_max: 150 mm/s
force_max: 50 N
watchdog: 100 ms
""",
        emulator=model,
        twin_address=f"/tmp/pomona/{model.replace('-', '_')}",
        due=(*due, "Fruit that bears 40 N: the gripper presses with 20 N a finger at least."),
        settings=("force=40 N", *settings),
    )


HAND_E = _piece(
    "hand-e",
    "53 mm",
    (
        "`devices.gripper.finger_offset` in cell.yaml: opening between the pads' faces when the gripper is closed.",
    ),
)
ROBOTIQ_2F_85 = _piece(
    "2f-85",
    "0 mm",
    (
        "robot.xml: its fingers slide along the line that touches the linkage's circle at 65 mm.",
        "With force fingers on its pads a light fruit slips on the twin: docs/results.md#two-finger-85.",
        "Fruit of 76 mm at most between its fingertips, which open by 85 mm.",
    ),
    ("fruit=apple_4",),
)
