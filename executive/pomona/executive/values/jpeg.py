"""Completeness of a JPEG: decoders fill missing parts with grey and report no error."""

from __future__ import annotations

_SCAN, _END = 0xDA, 0xD9
_ALONE = (0x01, *range(0xD0, 0xD8))
"""Markers that no length follows."""


def is_cut_off(content: bytes) -> bool:
    """Return True if this begins as a JPEG does and stops before the picture's end; False for all other files."""
    if content[:3] != b"\xff\xd8\xff":
        return False
    at, data = 2, False
    while True:
        at = content.find(b"\xff", at) if data else at
        if at < 0 or at + 2 > len(content):
            return True
        if content[at] != 0xFF:
            return False  # damaged in another way: the decoder's to judge
        marker = content[at + 1]
        if marker == 0xFF:  # padding
            at += 1
        elif marker == _END:
            return False
        elif marker == 0x00 or marker in _ALONE:  # a byte of the picture, or a point to start again from
            at += 2
        else:
            at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
            data = marker == _SCAN
