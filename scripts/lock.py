"""The exact packages that Pomona's default installation gets here today, each with the SHA-256 of its file.

    python scripts/lock.py requirements.lock
    pip install --require-hashes -r requirements.lock && pip install --no-deps .

Where torch is locked as `+cpu`, pip needs `--extra-index-url https://download.pytorch.org/whl/cpu`: PyPI has the build
with CUDA only.

It asks pip what it would install (`--dry-run --report`) and installs nothing. It holds for this kind of machine and
this Python only: another platform gets other files. That a file is what its maker published is the index's word.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]


def locked(report: Mapping[str, Any]) -> str:
    """The lock file of a report of pip.

    Raises:
        ValueError: a package comes from somewhere that gives no SHA-256.
    """
    lines = []
    for entry in report["install"]:
        about = entry["metadata"]
        if about["name"] == "pomona":
            continue
        hashes = entry["download_info"].get("archive_info", {}).get("hashes", {})
        if "sha256" not in hashes:
            raise ValueError(f"{about['name']} comes without a SHA-256 from {entry['download_info'].get('url')}")
        lines.append(f"{about['name'].lower()}=={about['version']} \\\n    --hash=sha256:{hashes['sha256']}\n")
    python = ".".join(platform.python_version_tuple()[:2])
    head = (
        f"# Made by `make lock` for Python {python} on {platform.system()} {platform.machine()}; see scripts/lock.py.\n"
    )
    return head + "".join(sorted(lines))


def main() -> int:
    """Write it."""
    out = Path(sys.argv[1])
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--quiet", "--report", "-"]
    done = subprocess.run([*command, str(REPOSITORY)], capture_output=True, text=True, check=False)
    if done.returncode:
        sys.stderr.write(done.stderr)
        return 1
    out.write_text(locked(json.loads(done.stdout)), encoding="utf-8")
    sys.stdout.write(f"{out}: {out.read_text(encoding='utf-8').count('--hash')} packages\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
