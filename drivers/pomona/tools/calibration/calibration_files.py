"""Calibration files for `pomona check`: intrinsics, hand-eye poses, and those of other programs."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from pomona.devices.frames.folder import read_intrinsics
from pomona.devices.frames.foreign_calibration import foreign_calibration, foreign_name
from pomona.devices.realsense.mounted_camera import UnusableHandEye, read_hand_eye
from pomona.drivers.camera_options import IntrinsicsSection
from pomona.executive.cell.errors import CellFileError
from pomona.executive.files import read_text
from pomona.executive.values.findings import Finding, Findings
from pomona.executive.values.kinds import Schema
from pomona.executive.values.sections import Section

HAND_EYE = "T_mount_camera"
FOCAL = {"fx", "fy"}


class CalibrationKind:
    """Files of a camera's intrinsics or pose, for `pomona check`; `pomona schema` has that of intrinsics."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one, of Pomona or of another program."""
        return bool(foreign_name(keys)) or HAND_EYE in keys or set(keys) >= FOCAL

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file; that of another program is named, with the words to write."""
        text = read_text(path)
        foreign = foreign_calibration(text)
        if foreign is not None:
            name, remedy = foreign
            findings.add(
                Finding(
                    str(path),
                    1,
                    1,
                    "error",
                    "foreign",
                    f"this is {name}, and no file of Pomona",
                    remedy,
                )
            )
            return
        try:
            if HAND_EYE in text:
                read_hand_eye(path)
            else:
                read_intrinsics(path)
        except CellFileError as error:
            findings.extend(error.findings)
        except UnusableHandEye as error:
            findings.add(Finding(str(path), 1, 1, "error", "value", str(error)))

    def schema(self) -> Schema:
        """Return the JSON Schema of a file of intrinsics."""
        return {"title": "Pomona intrinsics", **Section(IntrinsicsSection).schema()}


CALIBRATION_FILES = CalibrationKind()
