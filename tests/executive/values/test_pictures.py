"""Picture files of any origin: upright, of 8 bits, and a reason for every file that cannot be used."""

from __future__ import annotations

import contextlib
import io
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from PIL import Image, ImageOps, TiffImagePlugin

from pomona.executive.values import pictures
from pomona.executive.values.pictures import (
    UnusablePicture,
    decode_picture,
    decode_plane,
    read_picture,
    read_plane,
    write_picture,
)

ROOT = Path(__file__).resolve().parents[3]
RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 256, (12, 20, 3), dtype=np.uint8)


def coded(picture: Image.Image, kind: str, orientation: int = 1, **options: object) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    content = io.BytesIO()
    picture.save(content, kind, exif=exif.tobytes(), **options)
    return content.getvalue()


def png(width: int, height: int) -> bytes:
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(1000))),
        (b"IEND", b""),
    )
    chunks = (
        struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP"])
def test_a_picture_is_read_as_it_was_written(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{kind.lower()}"
    Image.fromarray(RGB).save(path)
    assert np.array_equal(read_picture(path), RGB)
    write_picture(tmp_path / "b.png", RGB)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "b.png")), RGB)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_picture_is_upright_as_pillow_turns_it(kind: str, orientation: int) -> None:
    whole = Image.fromarray(np.repeat(np.repeat(RGB, 8, axis=0), 8, axis=1))
    content = coded(whole, kind, orientation)
    expected = np.asarray(
        ImageOps.exif_transpose(Image.open(io.BytesIO(content))).convert("RGB")
    ).astype(int)
    got = decode_picture(content)
    assert got.shape == expected.shape
    assert np.abs(got - expected).mean() < 4.0  # two decoders of JPEG round differently
    if orientation > 1:
        with pytest.raises(
            UnusablePicture,
            match=f"its Exif orientation is {orientation}, but depth and intrinsics",
        ):
            decode_picture(content, as_taken=True)
    else:
        assert np.array_equal(decode_picture(content, as_taken=True), got)


def test_sixteen_bits_are_scaled_to_eight_and_those_of_a_sensor_are_refused(tmp_path: Path) -> None:
    deep = RNG.integers(0, 65536, (12, 20), dtype=np.uint16)
    deep[0, 0] = 65535
    write_picture(tmp_path / "deep.png", deep)  # type: ignore[arg-type]
    assert np.abs(read_picture(tmp_path / "deep.png")[..., 1] - deep / 257.0).max() <= 0.5
    assert np.array_equal(read_plane(tmp_path / "deep.png"), deep)
    write_picture(tmp_path / "dark.png", deep >> 4)  # type: ignore[arg-type]
    with pytest.raises(UnusablePicture, match="its 16 bits hold values up to 4095 only"):
        read_picture(tmp_path / "dark.png")
    Image.fromarray(RNG.random((12, 20)).astype(np.float32)).save(tmp_path / "float.tiff")
    with pytest.raises(UnusablePicture, match=r"float32|no picture|cannot be read"):
        read_picture(tmp_path / "float.tiff")


@pytest.mark.parametrize("kind", ["TIFF", "WEBP", "PNG", "GIF"])
def test_a_file_of_several_pictures_is_refused_with_their_number(kind: str) -> None:
    pages = [Image.fromarray(np.roll(RGB, k, axis=0)) for k in range(3)]
    for count in (1, 3):
        content = io.BytesIO()
        pages[0].save(content, kind, save_all=True, append_images=pages[1:count])
        for decode in (decode_picture, decode_plane):
            if count == 1:
                assert decode(content.getvalue()).shape[:2] == (12, 20)
                continue
            with pytest.raises(
                UnusablePicture,
                match="holds 3 pictures: store each that is wanted in a file of its",
            ):
                decode(content.getvalue())


def test_a_preview_or_a_mask_is_no_second_picture(tmp_path: Path) -> None:
    whole, small = Image.fromarray(RGB), Image.fromarray(RGB[::2, ::2])
    content = io.BytesIO()
    whole.save(content, "MPO", save_all=True, append_images=[small])
    assert decode_picture(content.getvalue()).shape == RGB.shape
    for kind, pictures_in_it in ((1, 1), (4, 1), (0, 2)):  # a preview, a mask, a page
        with TiffImagePlugin.AppendingTiffWriter(tmp_path / "pages.tif", new=True) as stream:
            for page, mark in ((whole, 0), (small, kind)):
                page.save(stream, tiffinfo={254: mark})
                stream.newFrame()
        if pictures_in_it == 1:
            assert np.array_equal(read_picture(tmp_path / "pages.tif"), RGB)
        else:
            with pytest.raises(UnusablePicture, match="holds 2 pictures"):
                read_picture(tmp_path / "pages.tif")


HEIC = b"\x00\x00\x00\x18ftypheic\x00\x00\x00\x00mif1heic" + bytes(64)
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
CUT = coded(Image.fromarray(RGB), "JPEG")[:-20]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "it is empty"),
        (b"no picture", "it is not one, or it is truncated"),
        (POINTER, "it is a pointer of Git LFS; `git lfs pull` fetches it"),
        (HEIC, "it is HEIC: convert it to JPEG or PNG"),
        (CUT, "its end is missing"),
        (coded(Image.fromarray(RGB), "PNG")[:-40], "it is not one, or it is truncated"),
        (png(100_000, 100_000), "100000 × 100000 px are more than"),
        (png(0, 3), "it is not one, or it is truncated"),
    ],
)
def test_a_file_that_is_no_picture_is_refused_with_its_reason(content: bytes, reason: str) -> None:
    for decode in (decode_picture, decode_plane):
        with pytest.raises(UnusablePicture, match=reason.replace("(", r"\(")):
            decode(content)


def test_a_file_that_cannot_be_opened_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    for name, reason in (
        ("none.png", "there is no such file"),
        ("pipe.png", "is no file"),
        ("", "is no file"),
    ):
        with pytest.raises(UnusablePicture, match=reason):
            read_picture(tmp_path / name)
    write_picture(tmp_path / "a.png", RGB)
    monkeypatch.setattr(pictures, "MOST_BYTES", 16)
    with pytest.raises(UnusablePicture, match="is larger than"):
        read_picture(tmp_path / "a.png")


@pytest.mark.skipif(os.name != "posix", reason="names of other systems are no bytes")
def test_a_name_that_is_not_utf8_is_a_name(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"\xc4pfel.png")
    write_picture(path, RGB)
    assert np.array_equal(read_picture(path), RGB)
    assert b"\xc4pfel.png" in os.listdir(os.fsencode(tmp_path))


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["PNG", "JPEG", "BMP"]), st.integers(0, 10_000), st.integers(0, 255))
def test_any_damaged_byte_gives_a_picture_or_a_reason(kind: str, at: int, byte: int) -> None:
    spoilt = bytearray(coded(Image.fromarray(RGB), kind, 6) if kind != "BMP" else _bmp())
    spoilt[at % len(spoilt)] = byte
    with contextlib.suppress(UnusablePicture):
        assert decode_picture(bytes(spoilt), as_taken=bool(byte % 2)).dtype == np.uint8


def _bmp() -> bytes:
    content = io.BytesIO()
    Image.fromarray(RGB).save(content, "BMP")
    return content.getvalue()


def test_no_other_part_reads_or_writes_pictures_with_opencv() -> None:
    sources = [path for part in ("executive", "drivers", "skills", "benchmarks", "scripts", "examples")
               for path in sorted((ROOT / part).rglob("*.py"))]  # fmt: skip
    assert len(sources) > 300
    own = ROOT / "executive" / "pomona" / "executive" / "values" / "pictures.py"
    for path in sources:
        text = path.read_text("utf-8")
        assert "cv2.imread(" not in text, path
        assert "cv2.imwrite(" not in text, path
        assert path == own or "cv2.imdecode(" not in text or path.name == "augmentation.py", path
