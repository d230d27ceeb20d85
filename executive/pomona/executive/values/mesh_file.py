"""Meshes from files that a person names: three formats, of a bounded size, judged before a library reads them."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = {".stl": 64_000_000, ".obj": 32_000_000, ".ply": 16_000_000}
"""Size limits [byte]: of `MOST_TRIANGLES`, an STL file in text has 50 MB, an OBJ file 20 MB and a PLY file 10 MB."""
MOST_TRIANGLES = 200_000  # a scan of a fruit has 20 000
MOST_LINES = 1_500_000  # an STL file of `MOST_TRIANGLES` in text has seven for each
LONGEST_LINE = 4096  # of a file in text: longer ones hold faces of hundreds of corners [byte]
# in text: an OBJ file of `MOST_TRIANGLES` without common corners holds 2.4 million
MOST_NUMBERS = 3_000_000
_HEADER = 4096  # a PLY file's header ends within these bytes

_COMMENT = re.compile(rb"^(comment|obj_info).*\n", re.MULTILINE)
_PLAIN_HEADER = b"""ply
format binary_little_endian 1.0
element vertex %d
property float x
property float y
property float z
element face %d
property list uchar int vertex_indices
"""

SUFFIXES = tuple(MOST_BYTES)
SIMPLIFY = "simplify it"


class UnreadableMeshError(ValueError):
    """A file that holds no mesh, or a too large one: why, as the rest of a sentence that its name begins."""


def read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices (n, 3) and triangles (m, 3) of a mesh file, as they are written, in its own unit.

    Raises:
        OSError: the file cannot be read.
        UnreadableMeshError: another format, too large, or no mesh with triangles of its own vertices.
    """
    _judge(path)
    if (plain := _plain_ply(path)) is not None:
        return plain
    import trimesh  # half a second to import

    try:
        loaded: Any = trimesh.load_mesh(path, process=False, skip_materials=True)
        vertices = np.array(loaded.vertices, np.float64)
        faces = np.array(loaded.faces, np.int64)
    except Exception as error:  # trimesh's readers may raise any exception
        words = " ".join(str(error).strip().strip("'").split())[:200] or type(error).__name__
        raise UnreadableMeshError(f"is no mesh that can be read ({words})") from error
    if (
        vertices.ndim != 2
        or vertices.shape[1] != 3
        or faces.ndim != 2
        or faces.shape[1] != 3
        or not len(faces)
    ):
        raise UnreadableMeshError("is empty: it holds no triangles")
    _bound(len(faces), MOST_TRIANGLES, "triangles")
    _bound(len(vertices), 3 * MOST_TRIANGLES, "vertices")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UnreadableMeshError("has triangles of vertices that it does not have")
    return vertices, faces


def _plain_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Read a binary PLY file of float x, y, z and triangles alone; None for every other one, which trimesh reads."""
    header, end, body = path.read_bytes().partition(b"end_header\n")
    counts = [int(count) for count in re.findall(rb"^element \w+ (\d+)$", header, re.MULTILINE)]
    if not end or len(counts) != 2 or _COMMENT.sub(b"", header) != _PLAIN_HEADER % (*counts,):
        return None
    vertices, faces = counts
    if len(body) != 12 * vertices + 13 * faces or not faces:
        return None
    points = np.frombuffer(body, "<f4", 3 * vertices).reshape(-1, 3).astype(np.float64)
    rows = np.frombuffer(body, [("corners", "u1"), ("at", "<i4", 3)], faces, 12 * vertices)
    triangles = rows["at"].astype(np.int64)
    is_plain = (rows["corners"] == 3).all() and 0 <= triangles.min() <= triangles.max() < vertices
    return (points, triangles) if is_plain else None


def _judge(path: Path) -> None:
    """Judge a file's name, its size, and the counts in it, without a library."""
    size = path.stat().st_size
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UnreadableMeshError(
            f"is none of {', '.join(SUFFIXES)}: export it in one of these formats"
        )
    if not path.is_file():
        raise UnreadableMeshError("is not a file")
    most = MOST_BYTES[suffix]
    if size > most:
        raise UnreadableMeshError(
            f"has {size / 1e6:.0f} MB, {most / 1e6:.0f} MB are read at most: {SIMPLIFY}"
        )
    content = path.read_bytes()
    if (
        suffix == ".stl"
        and len(content) >= 84
        and len(content) == 84 + 50 * struct.unpack_from("<L", content, 80)[0]
    ):
        _bound(len(content) // 50, MOST_TRIANGLES, "triangles")
    elif suffix == ".ply" and _ply_is_binary(content):
        return
    else:
        ends = np.flatnonzero(np.frombuffer(content, np.uint8) == 0x0A)
        _bound(len(ends), MOST_LINES, "lines")
        longest = int(np.diff(ends, prepend=-1, append=len(content)).max())
        _bound(longest, LONGEST_LINE, "characters in one line")
        if suffix != ".stl":  # in the others a face may have any number of corners
            _bound(content.count(b" ") + content.count(b"\t"), MOST_NUMBERS, "numbers")


def _ply_is_binary(content: bytes) -> bool:
    """Judge the counts in a PLY file's header; return True if its values are not in text."""
    header, end, _ = content[:_HEADER].partition(b"end_header")
    if not end:
        raise UnreadableMeshError(
            f"is no mesh that can be read (no PLY header ends within {_HEADER} bytes)"
        )
    for line in header.splitlines():
        words = line.split()
        if len(words) == 3 and words[0] == b"element":
            if not words[2].isdigit() or len(words[2]) > 12:
                raise UnreadableMeshError("is no mesh that can be read (its header counts nothing)")
            most = MOST_TRIANGLES if words[1] == b"face" else 3 * MOST_TRIANGLES
            _bound(
                int(words[2]), most, "triangles" if words[1] == b"face" else "elements of one kind"
            )
    return b"format ascii" not in header


def _bound(count: int, most: int, what: str) -> None:
    if count > most:
        raise UnreadableMeshError(f"has {count} {what}, {most} are read at most: {SIMPLIFY}")
