"""Write the catalogue's own meshes: `python -m skills.fruit.write_meshes`."""

from __future__ import annotations

import trimesh

from skills.fruit.apple_mesh import apple_mesh, stem_mesh
from skills.fruit.catalogue import CATALOGUE


def write_apple() -> None:
    """Write apple.ply and stem.ply (binary) of the CAD apple into the catalogue."""
    for name, (vertices, faces) in (("apple.ply", apple_mesh()), ("stem.ply", stem_mesh())):
        trimesh.Trimesh(vertices, faces, process=False).export(CATALOGUE / "apple" / name)


if __name__ == "__main__":
    write_apple()
