"""CRC-32 of a part, from the checksums before and behind it: a byte that two checksums cover is read once.

CRC-32 is linear: crc(a + b) = shifted(crc(a), len(b)) ^ crc(b), shifted by what so many zeros do. zlib calls it
crc32_combine (https://zlib.net/manual.html), which Python does not hand on.
"""

from __future__ import annotations

from functools import cache

POLYNOMIAL = 0xEDB88320

Operator = tuple[list[int], list[int], list[int], list[int]]
"""A linear map of checksums: what it makes of each value of their lowest byte, of the next one, and so on."""


def crc_of_end(before: int, after: int, length: int) -> int:
    """The checksum of the last `length` bytes, of the checksums before and behind them."""
    return after ^ shifted(before, length)


def shifted(crc: int, length: int) -> int:
    """What `length` zeros make of a checksum's linear part."""
    while length:
        a, b, c, d = _zeros(length.bit_length() - 1)
        crc = a[crc & 255] ^ b[crc >> 8 & 255] ^ c[crc >> 16 & 255] ^ d[crc >> 24]
        length ^= 1 << length.bit_length() - 1
    return crc


@cache
def _zeros(power: int) -> Operator:
    """What 2**power zeros make of a checksum."""
    if power:
        return _operator([shifted(shifted(1 << bit, 1 << power - 1), 1 << power - 1) for bit in range(32)])
    columns = []
    for bit in range(32):
        crc = 1 << bit
        for _ in range(8):
            crc = crc >> 1 ^ (POLYNOMIAL if crc & 1 else 0)
        columns.append(crc)
    return _operator(columns)


def _operator(columns: list[int]) -> Operator:
    tables = ([0], [0], [0], [0])
    for bit, column in enumerate(columns):
        table = tables[bit // 8]
        table += [entry ^ column for entry in table]
    return tables
