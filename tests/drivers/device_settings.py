"""Settings of one device from a file of its own, without a cell around it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pomona.executive.cell.registration import Driver, Settings, read_section_file
from pomona.executive.values.sections import Section


def read_settings(of: Driver[Any], path: Path) -> Settings[Any]:
    """Return the settings that a file holds. Raises CellFileError with all findings."""
    section = Section(of.options, ignore=("driver",))
    return read_section_file(
        path,
        "a device's settings",
        lambda file: Settings(path.stem, of, section.read_placed(file.root, file.reader)),
    )
