"""The installed distribution: its trees, the packages of its extras, and the pip commands that add to it or repair it.

An editable checkout, a wheel file and an index need different commands: pip records the origin of each installation
(PEP 610), and the commands name that origin.
"""

from __future__ import annotations

import importlib.metadata
import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from importlib.metadata import (
    EntryPoints,
    PackageNotFoundError,
    distribution as metadata_of,
    metadata,
    version,
)
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from pomona.executive.errors import UsageError
from pomona.executive.values.sentences import ReportLine

# distributions: everything, and the executive alone
WHOLE = "pomona"
ALONE = "pomona-executive"


@cache
def distribution() -> str:
    """Return the name of the installed distribution: `pomona`, or `pomona-executive` without it."""
    try:
        version(WHOLE)
    except PackageNotFoundError:
        return ALONE
    return WHOLE


def installed_version() -> str:
    """Version of the installed distribution."""
    return version(distribution())


def entry_points(**wanted: str) -> EntryPoints:
    """Return those of the installed packages; the files of all (15 ms) are read again after an installation only."""
    folders = tuple(
        (folder, os.stat(folder).st_mtime_ns) for folder in sys.path if os.path.exists(folder)
    )
    found: EntryPoints = _read_entry_points(folders).select(**wanted)
    return found


@lru_cache(maxsize=1)
def _read_entry_points(_folders: tuple[tuple[str, int], ...]) -> Any:
    return importlib.metadata.entry_points()


def further_checks(records: Sequence[Path] = (), cell: str = "") -> Iterator[ReportLine]:
    """Yield the lines of functions (records, cell) -> lines, by entry point `pomona.checks`.

    Args:
        records: their folders, of any cells; without any, the installation itself is checked.
        cell: name of the only cell to look at, as its newest record has it; empty: all of them.
    """
    for point in sorted(entry_points(group="pomona.checks"), key=lambda point: point.name):
        try:
            yield from point.load()(records, cell)
        except Exception as error:  # a package of a third party, or one that lacks another
            yield ReportLine(point.name, False, f"{point.value} cannot be asked: {error}")


def pip() -> str:
    """Return this environment's pip command: `pip` if the shell finds that one, else with this Python's path."""
    found = shutil.which("pip")
    here = found is not None and Path(found).parent == Path(sys.executable).parent
    return "pip" if here else f"{shlex.quote(sys.executable)} -m pip"


def install_extra(extra: str) -> str:
    """Return the command that adds an extra to the installed distribution."""
    return f"{pip()} install {_source(distribution(), extra)}"


def reinstall(name: str, *, requirements: bool = False) -> str:
    """Return the command that installs a distribution again, with or without its requirements."""
    alone = "" if requirements else "--no-deps "
    return f"{pip()} install --force-reinstall {alone}{_source(name)}"


def elsewhere(what: str) -> str:
    """Return the remedy for a thing of the distribution `pomona` where `pomona-executive` is installed."""
    return f"the distribution {WHOLE} has {what}: install it in an environment of its own, without {ALONE}"


def _source(name: str, extra: str = "") -> str:
    """Return pip's argument for installing a distribution from its origin, for a shell."""
    extras = f"[{extra}]" if extra else ""
    origin = _origin(name)
    url = str(origin.get("url", ""))
    if url.startswith("file:"):
        from urllib.request import url2pathname  # takes long to import

        place = Path(url2pathname(unquote(urlsplit(url).path)))
        editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
        gone = "" if place.exists() else f"  # {place} is gone: name its new place"
        return f"{editable}{shlex.quote(f'{place}{extras}')}{gone}"
    if vcs := origin.get("vcs_info"):
        url = f"{vcs['vcs']}+{url}@{vcs['commit_id']}"
    return shlex.quote(f"{name}{extras} @ {url}" if url else f"{name}{extras}")


def _origin(name: str) -> dict[str, Any]:
    """Return the record that pip keeps of a distribution that came from no index; empty for one from an index."""
    try:
        return dict(json.loads(metadata_of(name).read_text("direct_url.json") or "{}"))
    except (PackageNotFoundError, ValueError):
        return {}


def commit_here() -> str:
    """Short hash of the source's commit, with a + when files differ from it; empty outside a git checkout."""
    commit = _git("rev-parse", "--short=10", "HEAD")
    changed = _git("status", "--porcelain", "--untracked-files=no")
    return commit + ("+" if commit and changed else "")


def _git(*arguments: str) -> str:
    command = [
        "git",
        "--no-optional-locks",
        "-C",
        str(_POMONA),
        *arguments,
    ]  # reading must not lock the repository
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10.0)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()


_POMONA = Path(__file__).resolve().parents[2]


def installed_trees() -> Path:
    """Return `trees` of the installed package, or of the repository where the package is installed from a clone."""
    installed = _POMONA / "trees"
    return installed if installed.is_dir() else _POMONA.parents[1] / "trees"


def import_under(module: str, **environment: str) -> Any:
    """Import a module while these variables are set; the environment is then as before."""
    before = {name: os.environ[name] for name in environment if name in os.environ}
    os.environ.update(environment)
    try:
        return importlib.import_module(module)
    finally:
        for name in environment:
            del os.environ[name]
        os.environ.update(before)


@cache
def load_mujoco() -> Any:
    """Import MuJoCo without graphics; its warnings become lines of the log, not of a file in the working folder."""
    mujoco = import_under("mujoco", MUJOCO_GL="disable")
    mujoco.set_mju_user_warning(logging.getLogger(__name__).warning)
    return mujoco


_EXTRA_OF = {
    "PIL": "pictures",
    "matplotlib": "pictures",
    "scipy": "pictures",
    "torch": "torch",
    "onnx": "torch",
    "pygls": "lsp",
    "lsprotocol": "lsp",
}
"""Packages that are imported without `need`."""


def need(module: str, extra: str, what: str) -> Any:
    """Import a module that an extra brings.

    Args:
        extra: that installs it.
        what: the feature that needs it, for the message.

    Raises UsageError: it is not installed; names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UsageError(
            f"{what} needs the extra '{extra}': {install_extra(extra)} ({error})"
        ) from error


def remedy(module: str) -> str:
    """Return the command that helps when a module is not found."""
    extra = _EXTRA_OF.get(module.partition(".")[0], "")
    if extra in (metadata(distribution()).get_all("Provides-Extra") or ()):
        return install_extra(extra)
    return (
        "pomona doctor" if distribution() == WHOLE else reinstall(distribution(), requirements=True)
    )
