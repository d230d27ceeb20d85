from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.device import ConnectContext
from drivers.driver import read_settings
from drivers.errors import CellFileError, DeviceFault
from drivers.frames.camera import FramesCamera, connect
from drivers.interfaces import Camera, FrameSequence
from executive.clock import ManualClock

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


def connect_folder(cell: Path, folder: object, extra: str = f"intrinsics: {INTRINSICS}") -> FramesCamera:
    cell.write_text(f"driver: frames\nfolder: '{folder}'\n{extra}\n")
    return connect.connect(read_settings(connect, cell), ConnectContext(cell, ManualClock(5.0), 0))


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


def test_frames_come_in_the_order_of_their_names_with_depth_in_metres(cell: Path, folder: Path) -> None:
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
    camera.rewind()
    assert (camera.position, camera.count, camera.latest().label) == (0, 2, "a")


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
    (folder / "intrinsics.yaml").write_text("{fx: 500 px, fy: 501 px, cx: 19 px, cy: 14 px, width: 40, height: 30}")
    intrinsics = connect_folder(cell, folder).latest().intrinsics
    assert (intrinsics.fx, intrinsics.cy) == (500.0, 14.0)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: [path.unlink() for path in folder.iterdir()], "holds no frame"),
        (lambda folder: (folder / "b_depth_mm.png").unlink(), "b_depth_mm.png is missing"),
        (lambda folder: write_frame(folder, "a", size=(20, 40)), "is 40 x 20 pixels, the intrinsics are for 40 x 30"),
        (lambda folder: (folder / "a_color.png").write_bytes(b"no image"), "not an image"),
        (
            lambda folder: cv2.imwrite(str(folder / "a_depth_mm.png"), np.zeros((30, 40), np.uint8)),
            "1 x uint8, depth in mm is one channel of uint16",
        ),
    ],
)
def test_a_spoilt_folder_is_refused_in_words(cell: Path, folder: Path, spoil, words: str) -> None:  # type: ignore[no-untyped-def]
    spoil(folder)
    with pytest.raises(CellFileError, match=words) as caught:
        connect_folder(cell, folder)
    assert caught.value.line == 2


def test_a_missing_folder_or_no_folder_is_refused_with_what_to_do(cell: Path) -> None:
    with pytest.raises(CellFileError, match="there is no such folder"):
        connect_folder(cell, "elsewhere")
    with pytest.raises(CellFileError, match="--set folder=PATH"):
        connect_folder(cell, "")


def test_missing_or_impossible_intrinsics_are_refused(cell: Path, folder: Path) -> None:
    with pytest.raises(CellFileError, match=r"put intrinsics\.yaml into"):
        connect_folder(cell, folder, "")
    with pytest.raises(CellFileError, match="outside an image of 40 pixels"):
        connect_folder(cell, folder, f"intrinsics: {INTRINSICS.replace('cx: 20 ', 'cx: 2000 ')}")


def test_a_later_frame_that_cannot_be_used_is_a_fault_of_the_camera(cell: Path, folder: Path) -> None:
    camera = connect_folder(cell, folder)
    write_frame(folder, "b", size=(10, 10))
    camera.advance()
    with pytest.raises(DeviceFault, match="10 x 10 pixels"):
        camera.latest()
