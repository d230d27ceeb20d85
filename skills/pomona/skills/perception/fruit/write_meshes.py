"""Write the catalogue's own meshes: `python -m pomona.skills.perception.fruit.write_meshes`."""

from __future__ import annotations

import trimesh

from pomona.skills.perception.fruit.apple_mesh import apple_mesh, stem_mesh
from pomona.skills.perception.fruit.catalogue import CATALOGUE
from pomona.skills.perception.fruit.lemon_mesh import lemon_mesh


def write_meshes() -> None:
    """Write the meshes (binary PLY) that fruit.yaml files name into the catalogue."""
    meshes = {"apple/apple.ply": apple_mesh(), "apple/stem.ply": stem_mesh(), "lemon/lemon.ply": lemon_mesh()}
    for name, (vertices, faces) in meshes.items():
        trimesh.Trimesh(vertices, faces, process=False).export(CATALOGUE / name)


if __name__ == "__main__":
    write_meshes()
