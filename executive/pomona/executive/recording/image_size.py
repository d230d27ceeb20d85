"""How large a JPEG or PNG image is, without decoding it."""

from __future__ import annotations

import struct

FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of segments that hold the image's size."""
PNG = b"\x89PNG\r\n\x1a\n"


def size_of_image(coded: bytes) -> list[int]:
    """Return [width, height] in pixels; [0, 0] for a file that is neither JPEG nor PNG."""
    if coded.startswith(PNG) and len(coded) >= 24:
        return list(struct.unpack_from(">II", coded, 16))
    return size_of_jpeg(coded)


def size_of_jpeg(coded: bytes) -> list[int]:
    """Return [width, height] in pixels; [0, 0] for a file that is no JPEG image."""
    at = 2
    while at + 9 <= len(coded) and coded[at] == 0xFF:
        marker, (length,) = coded[at + 1], struct.unpack_from(">H", coded, at + 2)
        if marker in FRAMES:
            height, width = struct.unpack_from(">HH", coded, at + 5)
            return [width, height]
        at += 2 + length
    return [0, 0]
