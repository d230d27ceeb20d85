"""Write the exact versions that `make` installs, and the hashes of a run's packages.

    python scripts/lock.py              # constraints.txt and requirements.lock
    pip install -c constraints.txt '.[dev]'
    pip install --require-hashes -r requirements.lock && pip install --no-deps .

constraints.txt names the newest allowed version of every package of the installation with the extra `dev`. The same
versions are used on each supported Python. requirements.lock adds the SHA-256 of each file of the default
installation; it holds for this platform and this Python only. A hash shows that a file is the one that the index
delivered on the day of the lock.

pip resolves (`--dry-run --report`); nothing is installed.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
CONSTRAINTS, LOCK = REPOSITORY / "constraints.txt", REPOSITORY / "requirements.lock"


def constraints(report: Mapping[str, Any]) -> str:
    """Return the text of constraints.txt for a report of pip.

    Local labels such as `+cpu` are left out: an index without them serves the same release.
    """
    versions = {
        entry["metadata"]["name"].lower(): entry["metadata"]["version"]
        for entry in report["install"]
    }
    lines = [
        f"{name}=={version.partition('+')[0]}"
        for name, version in versions.items()
        if name != "pomona"
    ]
    return "\n".join(
        [
            "# Written by `make lock`: the versions that `make run` and `make test` install.",
            *sorted(lines),
            "",
        ]
    )


def locked(report: Mapping[str, Any]) -> str:
    """Return the text of requirements.lock for a report of pip.

    Raises:
        ValueError: the index gives no SHA-256 for a package.
    """
    lines = []
    for entry in report["install"]:
        about = entry["metadata"]
        if about["name"] == "pomona":
            continue
        hashes = entry["download_info"].get("archive_info", {}).get("hashes", {})
        if "sha256" not in hashes:
            raise ValueError(
                f"{about['name']} comes without a SHA-256 from {entry['download_info'].get('url')}"
            )
        lines.append(
            f"{about['name'].lower()}=={about['version']} \\\n    --hash=sha256:{hashes['sha256']}\n"
        )
    python = ".".join(platform.python_version_tuple()[:2])
    head = f"# Written by `make lock` for Python {python} on {platform.system()} {platform.machine()}.\n"
    return head + "".join(sorted(lines))


def resolved(*what: str) -> Mapping[str, Any]:
    """Return pip's report of an installation that is resolved but not carried out."""
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--dry-run",
        "--ignore-installed",
        "--quiet",
        "--report",
        "-",
    ]
    done = subprocess.run([*command, *what], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    report: Mapping[str, Any] = json.loads(done.stdout)
    return report


def main(arguments: Sequence[str]) -> int:
    """Write both files."""
    CONSTRAINTS.write_text(constraints(resolved(f"{REPOSITORY}[dev]")), encoding="utf-8")
    LOCK.write_text(locked(resolved("-c", str(CONSTRAINTS), str(REPOSITORY))), encoding="utf-8")
    for path in (CONSTRAINTS, LOCK):
        sys.stdout.write(f"{path.name}: {path.read_text(encoding='utf-8').count('==')} packages\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
