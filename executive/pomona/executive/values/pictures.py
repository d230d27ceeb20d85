"""Picture files of any origin: every part of Pomona reads and writes them here.

OpenCV decodes and codes bytes in memory. Its own functions for files end the process at a name that is not UTF-8, and
give no reason for a file that they cannot read.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pomona.executive.values.arrays import UInt8
from pomona.executive.values.image_bytes import is_cut_off, size_of_image

# of a picture that is decoded [px]: 0.75 GB; the largest photographs have 0.15e9
MOST_PIXELS = 250_000_000
MOST_BYTES = 1 << 30  # of a file [bytes]: an uncompressed picture of `MOST_PIXELS`
# values of 16 bits that all lie below are the 12 bits of a sensor, and black as a picture
DARK = 4096

LFS_POINTER = b"version https://git-lfs.github.com/spec/"
_FTYP = {
    b"heic": "HEIC",
    b"heix": "HEIC",
    b"hevc": "HEIC",
    b"mif1": "HEIC",
    b"msf1": "HEIC",
    b"avif": "AVIF",
}
# marks of data in which a turn may stand
_EXIF = (b"Exif", b"eXIf", b"EXIF", b"exif")
_TIFF = (b"II*", b"MM\0*")
# tag of Exif, and its value for pixels that are stored as they are seen
_ORIENTATION = 0x0112
_UPRIGHT = 1


class UnusablePicture(ValueError):
    """A file that is no picture, or none that can be used; the text is the reason and the remedy, without the path."""


def read_picture(path: Path, *, as_taken: bool = False) -> UInt8:
    """Read a picture: RGB, shape (h, w, 3), upright as its Exif orientation gives it; see `decode_picture`.

    Raises UnusablePicture: the file cannot be read or decoded.
    """
    return decode_picture(_content(path), as_taken=as_taken)


def decode_picture(content: bytes, *, as_taken: bool = False) -> UInt8:
    """Decode a picture: RGB, shape (h, w, 3), upright; 16 bits are scaled to 8.

    Args:
        as_taken: depth or intrinsics hold for its pixels as they are stored, so one that would be turned is refused.

    Raises UnusablePicture: it is none, is too large or incomplete, or is turned.
    """
    image = _decoded(content, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if as_taken and (turned := _orientation(content)) != _UPRIGHT:
        words = f"its Exif orientation is {turned}, but depth and intrinsics hold for pixels as they were taken"
        raise UnusablePicture(f"{words}: remove the orientation, or store the pixels upright")
    if image.dtype == np.uint16:
        if image.max(initial=0) < DARK:
            words = f"its 16 bits hold values up to {image.max(initial=0)} only, black as a picture"
            raise UnusablePicture(f"{words}: scale them to 65535")
        image = np.round(image / 257.0).astype(np.uint8)
    if image.dtype != np.uint8:
        raise UnusablePicture(f"its values are {image.dtype}: store 8 or 16 bits")
    return np.ascontiguousarray(image[..., ::-1])


def read_plane(path: Path) -> NDArray[Any]:
    """Read depth or a mask as it is stored: shape (h, w) or (h, w, channels), of its own type, never turned.

    Raises UnusablePicture: the file cannot be read or decoded.
    """
    return decode_plane(_content(path))


def decode_plane(content: bytes) -> NDArray[Any]:
    """Decode depth or a mask, shape (h, w) or (h, w, channels); see `read_plane`.

    Raises UnusablePicture: it is none, too large or incomplete.
    """
    return _decoded(content, cv2.IMREAD_UNCHANGED)


def write_picture(path: Path, picture: UInt8, quality: int = 95) -> None:
    """Write RGB, shape (h, w, 3), or a plane, shape (h, w), in the format of the path's ending.

    Args:
        quality: of a JPEG or WebP, 1 to 100.

    Raises OSError: it cannot be written.
    """
    pixels = np.ascontiguousarray(picture[..., ::-1] if picture.ndim == 3 else picture)
    name = cv2.IMWRITE_WEBP_QUALITY if path.suffix == ".webp" else cv2.IMWRITE_JPEG_QUALITY
    _coded, content = cv2.imencode(path.suffix, pixels, [name, quality])
    path.write_bytes(content.tobytes())


def is_lfs_pointer(content: bytes) -> bool:
    """Return True for the small text that Git LFS leaves in the place of a file that was not fetched."""
    return content.startswith(LFS_POINTER)


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():  # a pipe would be waited for
            raise UnusablePicture("is no file" if path.exists() else "there is no such file")
        if path.stat().st_size > MOST_BYTES:
            raise UnusablePicture(f"is larger than {MOST_BYTES >> 30} GiB")
        return path.read_bytes()
    except OSError as error:
        raise UnusablePicture(f"cannot be read: {error.strerror}") from error


def _decoded(content: bytes, flags: int) -> NDArray[Any]:
    if not content:
        raise UnusablePicture("cannot be read as a picture: it is empty")
    if is_lfs_pointer(content):
        raise UnusablePicture(
            "cannot be read as a picture: it is a pointer of Git LFS; `git lfs pull` fetches it"
        )
    if is_cut_off(content):
        raise UnusablePicture("cannot be read as a picture: its end is missing")
    width, height, count = _header(content)
    if width * height > MOST_PIXELS:
        raise UnusablePicture(
            f"cannot be read as a picture: {width} × {height} px are more than {MOST_PIXELS:.3g} px"
        )
    if count > 1:
        raise UnusablePicture(
            f"holds {count} pictures: store each that is wanted in a file of its own"
        )
    try:
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except (cv2.error, MemoryError):  # a header with a size beyond any memory
        image = None
    if image is None:
        kind = _FTYP.get(content[8:12], "") if content[4:8] == b"ftyp" else ""
        why = (
            f"it is {kind}: convert it to JPEG or PNG"
            if kind
            else "it is not one, or it is truncated"
        )
        raise UnusablePicture(f"cannot be read as a picture: {why}")
    return image


def _header(content: bytes) -> tuple[int, int, int]:
    """Return width and height [px] and the number of pictures that the header gives; 0, 0 and 1 where it is strange."""
    width, height = size_of_image(content)
    if width and b"acTL" not in content:  # a JPEG, or a PNG that is no animation
        return width, height, 1
    try:
        with Image.open(io.BytesIO(content)) as header:
            return *header.size, sum(
                _is_picture(header, k) for k in range(getattr(header, "n_frames", 1))
            )
    except Image.DecompressionBombError:
        return MOST_PIXELS, MOST_PIXELS, 1
    except Exception:  # Pillow's readers may raise any exception; OpenCV decides
        return width, height, 1


def _is_picture(header: Any, frame: int) -> bool:
    header.seek(frame)
    # in a TIFF: a preview, or a mask of another page
    return not getattr(header, "tag_v2", {}).get(254, 0) & 0b101


def _orientation(content: bytes) -> int:
    if not content.startswith(_TIFF) and not any(mark in content for mark in _EXIF):
        return _UPRIGHT  # to look for it, Pillow would decode a whole PNG
    try:
        with Image.open(io.BytesIO(content)) as header:
            return int(header.getexif().get(_ORIENTATION, _UPRIGHT))
    except Exception:  # as above
        return _UPRIGHT
