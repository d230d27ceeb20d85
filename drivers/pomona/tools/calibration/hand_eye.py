"""Hand-eye calibration: where the camera sits on the arm's flange, from looks at a chessboard that does not move.

    T_base_tool0 (i) · T_tool0_camera · T_camera_board (i) = T_base_board, the same for every look i

The rotation starts from Park and Martin's closed form ("Robot sensor calibration: solving AX = XB", 1994), the
translation from linear least squares; both are then refined together with the board's pose. OpenCV finds the board.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pomona.devices.frames.folder import INTRINSICS_FILE, read_intrinsics
from pomona.drivers.errors import CellFileError, DriverError
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.read_only import ReadOnly
from pomona.executive.values.rotations import is_rigid

LEAST_LOOKS = 5
LEAST_TURN = np.radians(
    15.0
)  # the flange must turn by at least this between some looks, about more than one axis
LEVER = 0.1  # a rotation error counts as much as the distance that it makes at this lever [m]

MOST_POSITION = 5e-3
MOST_ROTATION = np.radians(1.0)
"""Greatest residuals, rms [m, rad]. Twenty looks with 0.5 mm and 0.06° of noise leave less than 2 mm; one of them
that is 20 mm off leaves 7.3 mm."""

CAUSES = (
    "poses.json holds T_base_tool0 in metres, not in millimetres, not its inverse, each of its own picture; "
    "--square is the measured side of a square; intrinsics.yaml is of these pictures; the board did not move"
)


class UnusableLooks(DriverError):
    """Looks from which no calibration can be computed."""


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard: inner corners along both sides, and the side of a square [m].

    One of the two numbers must be odd and the other even, or the board looks the same when it is turned by 180°.
    """

    columns: int
    rows: int
    square: float

    @property
    def corners(self) -> NDArray[np.float32]:
        """Inner corners in the board's frame, shape (n, 3) [m]."""
        grid = np.zeros((self.rows * self.columns, 3), np.float32)
        grid[:, :2] = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square
        return grid


@dataclass(frozen=True, slots=True, eq=False)
class HandEye(ReadOnly):
    """The result and how well the looks agree with it."""

    T_tool0_camera: Float64  # pose of the camera in the flange
    T_base_board: Float64  # where the board stood
    position_error: (
        Float64  # of each look, distance of the board's origin from where it stood, shape (n,) [m]
    )
    rotation_error: Float64  # of each look, shape (n,) [rad]
    names: tuple[str, ...]  # of the looks

    @property
    def rms(self) -> tuple[float, float]:
        """Residuals of all looks in position [m] and rotation [rad]."""
        position, rotation = (
            float(np.sqrt((error**2).mean()))
            for error in (self.position_error, self.rotation_error)
        )
        return position, rotation

    def __str__(self) -> str:
        position, rotation = self.rms
        worst = int(self.position_error.argmax())
        residual = f"residual {1e3 * position:.2f} mm and {np.degrees(rotation):.3f}° rms"
        lines = [f"{len(self.names)} looks, {residual}"]
        for name, distance, angle in zip(
            self.names, self.position_error, self.rotation_error, strict=True
        ):
            lines.append(f"  {name:24} {1e3 * distance:6.2f} mm  {np.degrees(angle):6.3f}°")
        lines.append(
            f"worst: {self.names[worst]}; take it out if it stands out, and calibrate again"
        )
        return "\n".join(lines)

    def save(self, path: Path) -> None:
        """Write the file that a camera's `hand_eye` setting names."""
        position, rotation = self.rms
        content = {
            "T_mount_camera": self.T_tool0_camera.tolist(),
            "residual_mm": round(1e3 * position, 3),
            "residual_deg": round(float(np.degrees(rotation)), 4),
            "looks": len(self.names),
        }
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def find_board(
    image: NDArray[np.uint8], intrinsics: Intrinsics, board: Chessboard
) -> Float64 | None:
    """T_camera_board (4, 4) [m] of the board in an RGB image (h, w, 3), or None when it is not seen whole."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows))
    if not found:
        return None
    if not _starts_black(grey, corners.reshape(board.rows, board.columns, 2)):
        corners = corners[::-1]
    solved, rotation, translation = cv2.solvePnP(board.corners, corners, intrinsics.K, None)
    if not solved:
        return None
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(rotation)[0]
    T[:3, 3] = translation.ravel()
    return T


def calibrate_hand_eye(
    T_base_tool0: Float64, T_camera_board: Float64, names: tuple[str, ...] = ()
) -> HandEye:
    """Compute the camera's pose in the flange from poses of the flange and of the board, shape (n, 4, 4) each.

    Raises UnusableLooks: too few, the flange hardly turned between them, or they contradict each other.
    """
    count = len(T_base_tool0)
    if count < LEAST_LOOKS or len(T_camera_board) != count:
        raise UnusableLooks(f"needs at least {LEAST_LOOKS} looks with both poses, not {count}")
    _check_turns(T_base_tool0)
    A = _motions(T_base_tool0)
    B = _motions(_inverse(T_camera_board))
    R = _park_martin(A, B)
    t = _translation(A, B, R)
    T_tool0_camera = np.eye(4)
    T_tool0_camera[:3, :3], T_tool0_camera[:3, 3] = R, t
    T_base_board = T_base_tool0[0] @ T_tool0_camera @ T_camera_board[0]
    start = np.concatenate([_vector(T_tool0_camera), _vector(T_base_board)])
    fit = least_squares(
        lambda x: _residuals(x, T_base_tool0, T_camera_board).ravel(), start, method="lm"
    )
    residuals = _residuals(fit.x, T_base_tool0, T_camera_board)
    found = HandEye(
        _matrix(fit.x[:6]),
        _matrix(fit.x[6:]),
        np.linalg.norm(residuals[:, :3], axis=1),
        np.linalg.norm(residuals[:, 3:], axis=1) / LEVER,
        names or tuple(str(i) for i in range(count)),
    )
    position, rotation = found.rms
    if not (position <= MOST_POSITION and rotation <= MOST_ROTATION):
        raise UnusableLooks(f"the looks contradict each other. Check that {CAUSES}\n{found}")
    return found


def calibrate_folder(folder: Path, board: Chessboard) -> HandEye:
    """Calibrate from a folder: NAME.png or .jpg, poses.json (NAME → T_base_tool0, 4 × 4) and intrinsics.yaml.

    Raises UnusableLooks: a file is missing or wrong, or the board is seen too rarely.
    """
    if (board.columns + board.rows) % 2 == 0:
        raise UnusableLooks(
            "the board looks the same when turned by 180°: use one with 9 × 6 inner corners, for example"
        )
    try:
        intrinsics = read_intrinsics(folder / INTRINSICS_FILE)
        poses = {
            name: np.array(T, np.float64)
            for name, T in json.loads(read_plain_text(folder / "poses.json")).items()
        }
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, CellFileError) as error:
        raise UnusableLooks(f"{folder}: {error}") from error
    seen: dict[str, Float64] = {}
    for name, T in poses.items():
        if not is_rigid(T):
            raise UnusableLooks(
                f"{folder / 'poses.json'}: the pose of '{name}' is no rigid 4 × 4 transform"
            )
        path = next(
            (
                p
                for suffix in (".png", ".jpg", ".jpeg")
                if (p := folder / f"{name}{suffix}").is_file()
            ),
            None,
        )
        if path is None:
            raise UnusableLooks(f"{folder}: there is no image of the look '{name}'")
        T_camera_board = find_board(_picture(path, intrinsics), intrinsics, board)
        if T_camera_board is not None:
            seen[name] = T_camera_board
    if len(seen) < LEAST_LOOKS:
        corners = f"{board.columns} × {board.rows} inner corners"
        raise UnusableLooks(
            f"{folder}: the board ({corners}) is seen in {len(seen)} of {len(poses)} images"
        )
    return calibrate_hand_eye(
        np.stack([poses[name] for name in seen]), np.stack(list(seen.values())), tuple(seen)
    )


def _picture(path: Path, intrinsics: Intrinsics) -> UInt8:
    """Read the picture of a look, RGB (h, w, 3), of the size of the intrinsics."""
    try:
        picture = read_picture(path, as_taken=True)
    except UnusablePicture as error:
        raise UnusableLooks(f"{path}: {error}") from error
    if picture.shape[1::-1] != (intrinsics.width, intrinsics.height):
        size = f"{picture.shape[1]} x {picture.shape[0]}"
        words = f"{size} pixels, the intrinsics are for {intrinsics.width} x {intrinsics.height}"
        raise UnusableLooks(
            f"{path}: is {words}: use the pictures as the camera gave them, and their intrinsics"
        )
    return picture


def _starts_black(grey: NDArray[np.uint8], corners: Float64) -> bool:
    """Return True if the first inner square is darker than the next one, unlike on a board turned by 180°."""
    first, second = (corners[:2, i : i + 2].reshape(4, 2).mean(axis=0) for i in (0, 1))
    dark, light = (
        float(cv2.getRectSubPix(grey, (3, 3), (float(x), float(y))).mean())
        for x, y in (first, second)
    )
    return dark < light


def _check_turns(T: Float64) -> None:
    turns = Rotation.from_matrix(np.einsum("ji,njk->nik", T[0, :3, :3], T[:, :3, :3])).as_rotvec()
    strengths = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(T))
    if strengths[1] < LEAST_TURN / 2.0:
        raise UnusableLooks(
            "the flange hardly turned between the looks: turn it by 15° and more about two axes"
        )


def _inverse(T: Float64) -> Float64:
    return np.asarray(np.linalg.inv(T), dtype=np.float64)


def _motions(T: Float64) -> Float64:
    """Relative motions between all pairs of looks: inv(T_i) T_j, shape (pairs, 4, 4)."""
    i, j = np.triu_indices(len(T), 1)
    motions: Float64 = _inverse(T[i]) @ T[j]
    return motions


def _park_martin(A: Float64, B: Float64) -> Float64:
    """R with R log(B) ≈ log(A), in the least-squares sense."""
    alpha = Rotation.from_matrix(A[:, :3, :3]).as_rotvec()
    beta = Rotation.from_matrix(B[:, :3, :3]).as_rotvec()
    U, _, Vt = np.linalg.svd(alpha.T @ beta)
    R: Float64 = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R


def _translation(A: Float64, B: Float64, R: Float64) -> Float64:
    """t of (R_A − I) t = R t_B − t_A over all motions."""
    left = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (B[:, :3, 3] @ R.T - A[:, :3, 3]).ravel()
    return np.asarray(np.linalg.lstsq(left, right, rcond=None)[0], dtype=np.float64)


def _residuals(x: Float64, T_base_tool0: Float64, T_camera_board: Float64) -> Float64:
    """Position [m] and rotation [rad · lever] of the board of every look against where it stood, shape (n, 6)."""
    boards = T_base_tool0 @ _matrix(x[:6]) @ T_camera_board
    difference = _inverse(_matrix(x[6:])) @ boards
    turns = Rotation.from_matrix(difference[:, :3, :3]).as_rotvec()
    return np.hstack([difference[:, :3, 3], LEVER * turns])


def _vector(T: Float64) -> Float64:
    return np.concatenate([Rotation.from_matrix(T[:3, :3]).as_rotvec(), T[:3, 3]])


def _matrix(x: Float64) -> Float64:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix()
    T[:3, 3] = x[3:]
    return T
