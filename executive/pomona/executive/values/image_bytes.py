"""Size and completeness of an image file, without decoding it."""

from __future__ import annotations

import struct

_SCAN = 0xDA
_END = 0xD9
_ALONE = (0x01, *range(0xD0, 0xD8))  # markers that no length follows


def is_cut_off(content: bytes) -> bool:
    """Return True for a JPEG that stops before its end: decoders fill the missing part with grey, without an error."""
    if content[:3] != b"\xff\xd8\xff":
        return False
    at = 2
    data = False
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
        elif (
            marker == 0x00 or marker in _ALONE
        ):  # a byte of the picture, or a point to start again from
            at += 2
        else:
            at += 2 + int.from_bytes(content[at + 2 : at + 4], "big")
            data = marker == _SCAN


FRAMES = frozenset(range(0xC0, 0xD0)) - {
    0xC4,
    0xC8,
    0xCC,
}  # markers of segments that hold the image's size
PNG = b"\x89PNG\r\n\x1a\n"


def size_of_image(coded: bytes) -> list[int]:
    """[width, height] in pixels; [0, 0] for what is neither JPEG nor PNG."""
    if coded.startswith(PNG) and len(coded) >= 24:
        return list(struct.unpack_from(">II", coded, 16))
    at = 2
    while at + 9 <= len(coded) and coded[at] == 0xFF:
        marker, (length,) = coded[at + 1], struct.unpack_from(">H", coded, at + 2)
        if marker in FRAMES:
            height, width = struct.unpack_from(">HH", coded, at + 5)
            return [width, height]
        at += 2 + length
    return [0, 0]
