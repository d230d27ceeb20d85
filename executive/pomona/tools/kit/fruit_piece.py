"""Files written by `pomona new fruit`."""

from __future__ import annotations

import trimesh

from pomona.tools.kit.piece import Piece

RADII = (0.035, 0.04, 0.035)  # half the cuboid that the fruit fills [m]: y is the height


def mesh() -> bytes:
    """Return an ellipsoid, watertight, in metres."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    ball.apply_scale(RADII)
    data: bytes = ball.export(file_type="ply")
    return data


FRUIT = Piece(
    "a fruit: its file and a mesh, here an ellipsoid",
    {
        "$name/fruit.yaml": """# Object frame: origin at the cuboid's centre, x right, y down, z forward.
# The stem points along -y.
name: $name
mesh: $name.ply
dimensions: 0.070 0.080 0.070 m          # of the mesh: measure yours
symmetry_axis: [0, -1, 0]
colour: [0.60, 0.20, 0.30]
# weights: $name.weights                 # pomona train detect --fruit $name --out $name/$name.weights
"""
    },
    data={"$name/$name.ply": mesh},
    check="$name/fruit.yaml",
)
