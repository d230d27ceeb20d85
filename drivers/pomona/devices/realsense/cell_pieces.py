"""RealSense cameras as `pomona new cell` writes them."""

from __future__ import annotations

from pomona.executive import CellPiece

D435I = CellPiece(
    role="camera",
    device="""driver: realsense         # with several cameras: serial
size: [640, 480]
rate: 30 Hz
preset: High Accuracy
filters: spatial temporal
hand_eye: hand_eye.json   # README.md: due
""",
    twin="""driver: emulated-camera
address: "{camera}"
robot: robot.xml
rate: 5 Hz
""",
    simulated="include: sim.yaml#devices/camera",
    due=(
        "hand_eye.json, the camera's pose: `pomona calibrate hand-eye LOOKS --board 9x6 --square 24.5mm --out "
        "hand_eye.json`. The folder LOOKS holds ten images of a chessboard or more, poses.json with the flange at each "
        "and intrinsics.yaml: docs/calibrate.md.",
        "Depth errors of the camera: `pomona calibrate depth --help`.",
    ),
)
