"""A device as `pomona new cell` writes it: each arm, hand and camera names its own by entry point."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CellPiece:
    """An entry point of the group `pomona.cell_pieces`; blocks are YAML without indentation, beside `robot.xml`.

    Attributes:
        role: key under `devices:`: arm, gripper or camera.
        device: block of the real device; `"{arm}"`, or the role, stands for its address.
        simulated: block of the simulated device.
        twin: block of the emulated cell; by default the real device's, with another address.
        address: in the real cell, as an example; empty for a device without one.
        address_help: which address it is.
        emulator: entry point of the emulated device, in `pomona.emulators`; empty for a camera.
        twin_address: where the driver finds the emulated device; a camera has that of the emulated world.
        workspace: shipped block with poses for this arm; empty for others.
        due: calibrations and settings before the first motion.
        settings: `--set` of a pick without force fingers, such as "force=40 N".
        beside: devices that come with it, such as the force sensor in an arm; they may use its address.
    """

    role: str
    device: str
    simulated: str
    twin: str = ""
    address: str = ""
    address_help: str = ""
    emulator: str = ""
    twin_address: str = ""
    workspace: str = ""
    due: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    beside: tuple[CellPiece, ...] = ()
