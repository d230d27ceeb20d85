import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.drivers.interfaces import Intrinsics
from pomona.tools.calibration.hand_eye import (
    Chessboard,
    UnusableLooks,
    calibrate_folder,
    calibrate_hand_eye,
    find_board,
)

INTRINSICS = Intrinsics(600.0, 602.0, 319.0, 241.0, 640, 480)
BOARD = Chessboard(8, 5, 0.03)


def pose(turn: tuple[float, float, float], place: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = place
    return T


T_TOOL0_CAMERA = pose((0.02, -0.03, 1.55), (-0.078, 0.004, 0.030))
T_BASE_BOARD = pose(
    (3.1, 0.02, 0.4), (-0.05, -0.35, -0.12)
)  # its z points into the table, as OpenCV has it


def looks(count: int = 12, seed: int = 0, turn: float = 0.35) -> tuple[np.ndarray, np.ndarray]:
    """Flange poses from which the camera looks at the board, and the board's pose in the camera."""
    rng = np.random.default_rng(seed)
    flanges, boards = [], []
    middle = T_BASE_BOARD @ pose((0.0, 0.0, 0.0), (0.09, 0.06, 0.0))
    for _ in range(count):
        tilt = Rotation.from_rotvec(rng.uniform(-turn, turn, 3)).as_matrix()
        T = np.eye(4)
        T[:3, :3] = middle[:3, :3] @ tilt  # looking down at it
        T[:3, 3] = middle[:3, 3] - 0.45 * T[:3, 2] + rng.uniform(-0.02, 0.02, 3)
        flanges.append(T @ np.linalg.inv(T_TOOL0_CAMERA))
        boards.append(np.linalg.inv(T) @ T_BASE_BOARD)
    return np.stack(flanges), np.stack(boards)


def test_exact_looks_give_the_exact_transform_and_no_residual() -> None:
    result = calibrate_hand_eye(*looks())
    assert result.T_tool0_camera == pytest.approx(T_TOOL0_CAMERA, abs=1e-9)
    assert result.T_base_board == pytest.approx(T_BASE_BOARD, abs=1e-9)
    assert result.position_error.max() < 1e-9


def test_noisy_looks_give_it_within_the_noise_and_an_outlier_is_refused_by_its_name() -> None:
    flanges, boards = looks(20)
    rng = np.random.default_rng(1)
    for T in boards:
        T[:3, 3] += rng.normal(0.0, 5e-4, 3)
        T[:3, :3] = Rotation.from_rotvec(rng.normal(0.0, 1e-3, 3)).as_matrix() @ T[:3, :3]
    result = calibrate_hand_eye(flanges, boards)
    assert np.linalg.norm(result.T_tool0_camera[:3, 3] - T_TOOL0_CAMERA[:3, 3]) < 2.5e-3
    assert 2e-4 < np.sqrt((result.position_error**2).mean()) < 2e-3
    boards[7, :3, 3] += 0.02
    with pytest.raises(UnusableLooks, match="worst: look 7"):
        calibrate_hand_eye(flanges, boards, tuple(f"look {i}" for i in range(20)))


def test_too_few_looks_or_no_turning_are_refused() -> None:
    with pytest.raises(UnusableLooks, match="at least 5"):
        calibrate_hand_eye(*looks(4))
    with pytest.raises(UnusableLooks, match="hardly turned"):
        calibrate_hand_eye(*looks(10, turn=0.01))


def in_millimetres(flanges: np.ndarray, boards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    flanges[:, :3, 3] *= 1e3
    return flanges, boards


def twice_the_square(flanges: np.ndarray, boards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    boards[:, :3, 3] *= 2.0
    return flanges, boards


@pytest.mark.parametrize(
    "spoil",
    [
        in_millimetres,
        twice_the_square,
        lambda flanges, boards: (np.linalg.inv(flanges), boards),
        lambda flanges, boards: (np.roll(flanges, 1, axis=0), boards),
        lambda flanges, boards: (flanges[[1, *range(1, 12)]], boards),
    ],
    ids=["millimetres", "square", "inverted", "of the next picture", "one of another picture"],
)
def test_looks_that_contradict_each_other_are_refused_with_the_likely_causes(
    spoil: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> None:
    with pytest.raises(
        UnusableLooks, match=r"contradict each other\. Check that poses\.json"
    ) as caught:
        calibrate_hand_eye(*spoil(*looks()))
    assert "worst: " in str(caught.value)


def draw(T_camera_board: np.ndarray) -> np.ndarray:
    """A picture of the board by warping its plane: independent of how it is found."""
    square = 20
    rows, columns = BOARD.rows + 1, BOARD.columns + 1
    flat = np.full(((rows + 2) * square, (columns + 2) * square), 255, np.uint8)
    for r in range(rows):
        for c in range(columns):
            if (r + c) % 2 == 0:
                flat[(r + 1) * square : (r + 2) * square, (c + 1) * square : (c + 2) * square] = 0
    scale = (
        BOARD.square / square
    )  # inner corner (0, 0) is the board's origin: two squares from the picture's edge
    plane = np.array(
        [
            [scale, 0.0, (0.5 - 2 * square) * scale],
            [0.0, scale, (0.5 - 2 * square) * scale],
            [0, 0, 1.0],
        ]
    )
    H = INTRINSICS.K @ T_camera_board[:3, [0, 1, 3]] @ plane
    grey = cv2.warpPerspective(flat, H, (640, 480), flags=cv2.INTER_AREA, borderValue=200)
    return np.repeat(grey[..., None], 3, axis=2)


def test_the_board_is_found_where_it_was_drawn() -> None:
    _, boards = looks(3)
    for T in boards:
        found = find_board(draw(T), INTRINSICS, BOARD)
        assert found is not None
        assert np.linalg.norm(found[:3, 3] - T[:3, 3]) < 2e-3
    assert find_board(np.full((480, 640, 3), 128, np.uint8), INTRINSICS, BOARD) is None


def test_a_folder_of_looks_is_calibrated_and_its_file_holds_the_pose(tmp_path: Path) -> None:
    flanges, boards = looks(8)
    for i, T in enumerate(boards):
        cv2.imwrite(str(tmp_path / f"look_{i}.png"), draw(T))
    (tmp_path / "poses.json").write_text(
        json.dumps({f"look_{i}": T.tolist() for i, T in enumerate(flanges)})
    )
    (tmp_path / "intrinsics.yaml").write_text(
        "{fx: 600 px, fy: 602 px, cx: 319 px, cy: 241 px, width: 640, height: 480}"
    )
    result = calibrate_folder(tmp_path, BOARD)
    assert np.linalg.norm(result.T_tool0_camera[:3, 3] - T_TOOL0_CAMERA[:3, 3]) < 4e-3
    result.save(tmp_path / "hand_eye.json")
    assert (
        json.loads((tmp_path / "hand_eye.json").read_text())["T_mount_camera"]
        == result.T_tool0_camera.tolist()
    )
    (tmp_path / "look_3.png").unlink()
    with pytest.raises(UnusableLooks, match="turned by 180°"):
        calibrate_folder(tmp_path, Chessboard(7, 5, 0.03))
    with pytest.raises(UnusableLooks, match="no image of the look 'look_3'"):
        calibrate_folder(tmp_path, BOARD)
    (tmp_path / "look_3.png").write_bytes(b"no picture")
    with pytest.raises(UnusableLooks, match=r"look_3\.png: cannot be read as a picture"):
        calibrate_folder(tmp_path, BOARD)
    cv2.imwrite(str(tmp_path / "look_3.png"), cv2.resize(draw(boards[3]), (320, 240)))
    with pytest.raises(
        UnusableLooks, match=r"look_3\.png: is 320 x 240 pixels, the intrinsics are for 640 x 480"
    ):
        calibrate_folder(tmp_path, BOARD)
