import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from PIL import Image

from pomona.devices.frames import folder as folder_module
from pomona.devices.frames.camera import FramesCamera, connect
from pomona.devices.frames.folder import list_frames
from pomona.drivers.errors import CellFileError, FrameUnreadable
from pomona.drivers.interfaces import Camera, FrameSequence
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import ManualClock
from tests.drivers.device_settings import read_settings

INTRINSICS = "{fx: 600 px, fy: 601 px, cx: 20 px, cy: 15 px, width: 40, height: 30}"


def write_frame(
    folder: Path, label: str, red: int = 200, depth_mm: int = 750, size: tuple[int, int] = (30, 40)
) -> None:
    colour = np.zeros((*size, 3), np.uint8)
    colour[..., 2] = red  # OpenCV writes BGR
    depth = np.full(size, depth_mm, np.uint16)
    depth[0, 0] = 0
    cv2.imwrite(str(folder / f"{label}_color.png"), colour)
    cv2.imwrite(str(folder / f"{label}_depth_mm.png"), depth)


def connect_folder(
    cell: Path, folder: object, extra: str = f"intrinsics: {INTRINSICS}"
) -> FramesCamera:
    cell.write_text(f"driver: frames\nfolder: '{folder}'\n{extra}\n")
    return connect.connect(read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0))


def animated(folder: Path, name: str) -> None:
    pages = [Image.fromarray(np.full((30, 40), k, np.uint16)) for k in (700, 800)]
    pages[0].save(folder / name, "TIFF", save_all=True, append_images=pages[1:])


def cut_off(folder: Path) -> None:
    """Half of a JPEG: OpenCV makes the rest grey, and a fruit of the grey half is missed without a word."""
    (folder / "a_color.png").unlink()
    content = cv2.imencode(
        ".jpg", np.random.default_rng(0).integers(0, 256, (30, 40, 3)).astype(np.uint8)
    )[1].tobytes()
    (folder / "a_color.jpg").write_bytes(content[: -len(content) // 3])


def exchanged(folder: Path) -> None:
    """Write a table at a slant whose two bytes are exchanged."""
    slant = np.round(
        np.linspace(600, 900, 30)[:, None] + np.random.default_rng(1).normal(0, 2, (30, 40))
    )
    cv2.imwrite(str(folder / "a_depth_mm.png"), slant.astype(np.uint16).byteswap())


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    (tmp_path / "frames").mkdir()
    return tmp_path / "cell.yaml"


@pytest.fixture
def folder(cell: Path) -> Path:
    folder = cell.parent / "frames"
    write_frame(folder, "b", red=20, depth_mm=1000)
    write_frame(folder, "a")
    return folder


def test_frames_come_in_the_order_of_their_names_with_depth_in_metres(
    cell: Path, folder: Path
) -> None:
    camera = connect_folder(cell, folder)
    first = camera.latest()
    assert first is not None
    assert (first.label, first.sequence, first.stamp, first.q) == ("a", 0, 5.0, None)
    assert first.colour[5, 5].tolist() == [200, 0, 0]
    assert first.depth is not None
    assert first.depth.dtype == np.float32
    assert first.depth[0, 0] == 0.0
    assert first.depth[5, 5] == pytest.approx(0.75)
    assert camera.advance()
    second = camera.latest()
    assert (second.label, second.sequence) == ("b", 1)
    assert not camera.advance()
    assert camera.latest().label == "b"
    assert camera.count == 2


def test_it_is_a_camera_and_a_sequence(cell: Path, folder: Path) -> None:
    camera = connect_folder(cell, folder)
    assert isinstance(camera, Camera)
    assert isinstance(camera, FrameSequence)


def test_a_recorded_frame_is_as_new_as_the_look_at_it(cell: Path, folder: Path) -> None:
    camera = connect_folder(cell, folder)
    camera._clock.advance(60.0)
    assert camera.latest().stamp == 65.0


def test_a_relative_folder_is_meant_from_the_cell_file(cell: Path, folder: Path) -> None:
    assert connect_folder(cell, "frames").count == 2


def test_intrinsics_in_the_folder_come_first(cell: Path, folder: Path) -> None:
    (folder / "intrinsics.yaml").write_text(
        "{fx: 500 px, fy: 501 px, cx: 19 px, cy: 14 px, width: 40, height: 30}"
    )
    intrinsics = connect_folder(cell, folder).latest().intrinsics
    assert (intrinsics.fx, intrinsics.cy) == (500.0, 14.0)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda folder: [path.unlink() for path in folder.iterdir()],
            "holds no frame.*`pomona detect` finds fruit",
        ),
        (lambda folder: (folder / "b_depth_mm.png").unlink(), "b_depth_mm.png is missing"),
        (
            lambda folder: (folder / "b_depth_mm.png").rename(folder / "b2_depth_mm.png"),
            "b_depth_mm.png is missing; b2_depth_mm.png has no colour and is of another moment",
        ),
        (
            lambda folder: animated(folder, "a_depth_mm.png"),
            "a_depth_mm.png: holds 2 pictures: store each",
        ),
        (
            lambda folder: animated(folder, "a_color.png"),
            "a_color.png: holds 2 pictures: store each",
        ),
        (
            lambda folder: write_frame(folder, "a", depth_mm=2),
            "up to 2 mm, nearer than any camera measures",
        ),
        (
            exchanged,
            "its depth is smooth only in the other byte order: it was written with bytes exchanged",
        ),
        (lambda folder: (folder / "frames.json").write_text("[]}"), "is no list of frames"),
        (
            lambda folder: (folder / "frames.json").write_text('[{"T_base_camera": 1}]'),
            "is no list of frames",
        ),
        (
            lambda folder: (folder / "frames.json").write_text(
                '[{"label": "a", "T_base_camera": [[2.0]]}]'
            ),
            "the pose of 'a' is no rigid 4 x 4 transform",
        ),
        (
            lambda folder: write_frame(folder, "a", size=(20, 40)),
            "is 40 x 20 pixels, the intrinsics are for 40 x 30",
        ),
        (
            lambda folder: (folder / "a_color.png").write_bytes(b"no image"),
            "cannot be read as a picture",
        ),
        (lambda folder: (folder / "a_color.png").write_bytes(b""), "cannot be read as a picture"),
        (cut_off, "a_color.jpg: cannot be read as a picture: its end is missing"),
        (
            lambda folder: cv2.imwrite(
                str(folder / "a_depth_mm.png"), np.zeros((20, 40), np.uint16)
            ),
            "is 40 x 20 pixels, and its colour 40 x 30: depth must be registered to colour",
        ),
        (
            lambda folder: cv2.imwrite(
                str(folder / "a_color.jpg"), np.zeros((30, 40, 3), np.uint8)
            ),
            "a_color.png: is a second colour image of a_depth_mm.png, beside a_color.jpg",
        ),
        (lambda folder: (folder / "frames.json").write_text("{}"), "is no list of frames"),
        (
            lambda folder: (folder / "frames.json").write_text('[{"label": "a"}, {"label": "a"}]'),
            "two entries have the same label",
        ),
        (
            lambda folder: (folder / "frames.json").write_text('[{"label": "A"}]'),
            "names none of the frames of the folder. Its first label is 'A', the first frame is 'a'",
        ),
        (
            lambda folder: cv2.imwrite(
                str(folder / "a_depth_mm.png"), np.zeros((30, 40), np.uint8)
            ),
            "1 x uint8, depth in mm is one channel of uint16",
        ),
    ],
)
def test_a_spoilt_folder_is_refused_in_words(cell: Path, folder: Path, spoil, words: str) -> None:  # type: ignore[no-untyped-def]
    spoil(folder)
    with pytest.raises(CellFileError, match=words) as caught:
        connect_folder(cell, folder)
    assert caught.value.line == 2


def test_a_missing_folder_or_no_folder_is_refused_with_the_remedy(cell: Path) -> None:
    with pytest.raises(CellFileError, match="there is no such folder"):
        connect_folder(cell, "elsewhere")
    with pytest.raises(CellFileError, match="--set folder=PATH"):
        connect_folder(cell, "")


def test_missing_or_impossible_intrinsics_are_refused(cell: Path, folder: Path) -> None:
    with pytest.raises(CellFileError, match=r"put intrinsics\.yaml into"):
        connect_folder(cell, folder, "")
    with pytest.raises(CellFileError, match="outside an image of 40 pixels"):
        connect_folder(cell, folder, f"intrinsics: {INTRINSICS.replace('cx: 20 ', 'cx: 2000 ')}")


def test_a_later_unreadable_frame_is_reported_and_the_next_one_is_shown(
    cell: Path, folder: Path
) -> None:
    write_frame(folder, "c")
    camera = connect_folder(cell, folder)
    write_frame(folder, "b", size=(10, 10))
    camera.advance()
    with pytest.raises(FrameUnreadable, match=r"b_color\.png: is 10 x 10 pixels"):
        camera.latest()
    assert camera.advance()
    assert camera.latest().label == "c"


def test_the_camera_pose_is_read_where_the_folder_has_it(cell: Path, folder: Path) -> None:
    T = np.diag([-1.0, -1.0, 1.0, 1.0])
    entries = [{"label": "a", "T_base_camera": T.tolist()}, {"label": "b", "T_base_camera": None}]
    (folder / "frames.json").write_text(json.dumps(entries))
    camera = connect_folder(cell, folder)
    first = camera.latest()
    assert first.placed
    assert np.array_equal(first.T_mount_camera, T)
    camera.advance()
    assert not camera.latest().placed


def test_one_of_so_many_frames_is_shown_when_that_is_asked_for(cell: Path, folder: Path) -> None:
    for label in "cdefg":
        write_frame(folder, label)
    camera = connect_folder(cell, folder, f"every: 3\nintrinsics: {INTRINSICS}")
    labels = [camera.latest().label]
    while camera.advance():
        labels.append(camera.latest().label)
    assert labels == ["a", "d", "g"]


def test_a_camera_that_the_folder_does_not_name_is_reported(
    cell: Path, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    connect_folder(cell, folder)
    assert "no intrinsics.yaml there" in caplog.text
    caplog.clear()
    (folder / "intrinsics.yaml").write_text(INTRINSICS)
    connect_folder(cell, folder)
    assert not caplog.text


@pytest.mark.parametrize("focal", ["0 px", ".nan px", "nan px", "-600 px", "600"])
def test_a_focal_length_that_is_none_is_refused_with_its_place(
    cell: Path, folder: Path, focal: str
) -> None:
    (folder / "intrinsics.yaml").write_text(INTRINSICS.replace("600 px", focal))
    with pytest.raises(CellFileError, match="fx") as caught:
        connect_folder(cell, folder)
    assert (caught.value.path.name, caught.value.line) == ("intrinsics.yaml", 1)


@pytest.mark.parametrize("focal", ["1200 px", "300 px"])
def test_pixels_twice_as_high_as_wide_are_refused(cell: Path, folder: Path, focal: str) -> None:
    (folder / "intrinsics.yaml").write_text(INTRINSICS.replace("600 px", focal))
    with pytest.raises(
        CellFileError, match=r"fx: it is .* and fy is 601 px: a camera's are nearly the same"
    ):
        connect_folder(cell, folder)


def test_a_focal_length_in_millimetres_is_refused(cell: Path, folder: Path) -> None:
    (folder / "intrinsics.yaml").write_text(
        INTRINSICS.replace("600 px", "3.6 px").replace("601 px", "3.6 px")
    )
    with pytest.raises(
        CellFileError, match=r"fx: it is 3\.6 px in an image of 40 px: is it in mm\?"
    ):
        connect_folder(cell, folder)


def test_an_empty_file_of_intrinsics_is_no_empty_tree(cell: Path, folder: Path) -> None:
    (folder / "intrinsics.yaml").write_text("")
    with pytest.raises(
        CellFileError, match="the file is empty, a file of intrinsics is a mapping\n"
    ):
        connect_folder(cell, folder)


def test_a_macs_hidden_file_is_no_frame(cell: Path, folder: Path) -> None:
    for name in ("a_color.png", "a_depth_mm.png"):
        (folder / f"._{name}").write_bytes(b"Mac OS X")
    assert [frame.label for frame in list_frames(folder)] == ["a", "b"]


@pytest.mark.slow
def test_a_folder_of_a_hundred_thousand_files_is_listed_by_their_names_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [f"{k:06d}_{kind}" for k in range(50_000) for kind in ("color.png", "depth_mm.png")]
    monkeypatch.setattr(
        folder_module.os, "scandir", lambda _folder: [SimpleNamespace(name=name) for name in names]
    )
    monkeypatch.setattr(Path, "is_file", None)  # no look at any of them
    frames = list_frames(tmp_path)
    assert (len(frames), frames[-1].label) == (50_000, "049999")
