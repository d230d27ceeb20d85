"""The folder of trees, cells, robots and fruit that come with Pomona."""

from pathlib import Path

_POMONA = Path(__file__).resolve().parents[2]


def installed_trees() -> Path:
    """Return `trees` of the installed package, or of the repository where the package is installed from a clone."""
    installed = _POMONA / "trees"
    return installed if installed.is_dir() else _POMONA.parents[1] / "trees"
