"""Make a release: judge the repository, build both wheels and the sdist, try all in clean environments, tag.

    python scripts/release.py            # everything but the tag
    python scripts/release.py --tag      # the tag, too: v and the version of pyproject.toml; nothing is pushed
    python scripts/release.py --shared   # the environments share the packages installed here (a minute, not ten)
    python scripts/release.py --python python3.12 --python python3.13   # with these, not with each that is found

Each environment holds the newest allowed packages. It tests the version, the check of a shipped tree, the simulated
pick, its tables, a detection in the pictures of these tables, and a campaign of two runs.
"""

from __future__ import annotations

import argparse
import itertools
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

PLACEHOLDER = "example.org"
"""Address in the project's files until the public one is decided."""
ADDRESSED = (
    "pyproject.toml",
    "CITATION.cff",
    "mkdocs.yml",
    "SECURITY.md",
    ".github/ISSUE_TEMPLATE/config.yml",
)
"""Files with public addresses."""
PYTHONS = ("python3.11", "python3.12", "python3.13")
"""Versions that the package supports (pyproject.toml, `requires-python` and classifiers)."""
TRIED = (
    ("--version",),
    ("check", "pick_apple"),
    ("run", "pick_apple", "--seed", "3"),
    ("explain", "last"),
    ("runs", "export", "last", "tables", "--to", "frames"),
    ("detect", "tables/frames", "--weights", "apple.weights"),
    ("campaign", "two.campaign.yaml", "--workers", "1"),
)
CAMPAIGN = """pomona: 1
campaign: two
tree: pick_apple
cell: sim
seeds: 2
"""
TRIED_ALONE = (
    ("--version",),
    ("check", "count_down"),
    ("run", "count_down"),
    ("explain", "last"),
)
"""Commands of an installed Pomona, and of `pomona-executive`, that must end with 0."""


def problems(root: Path, version: str) -> Iterator[str]:
    """Why this cannot be released, in words; nothing when it can."""
    changelog = (root / "CHANGELOG.md").read_text("utf-8")
    if not re.search(
        rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$", changelog, re.MULTILINE
    ):
        yield f"CHANGELOG.md has no heading '## [{version}] - 2026-01-31' (with the day of the release)"
    cited = re.search(r"^version: (.*)$", (root / "CITATION.cff").read_text("utf-8"), re.MULTILINE)
    if cited is None or cited[1] != version:
        yield f"CITATION.cff is not about version {version}"
    if git(root, "status", "--porcelain"):
        yield "there are changes that are not committed"
    if f"v{version}" in git(root, "tag").split():
        yield f"v{version} is a tag already"


def placeholders(root: Path) -> Iterator[str]:
    """Yield the files that hold no public address yet."""
    for name in ADDRESSED:
        if PLACEHOLDER in (root / name).read_text("utf-8"):
            yield f"{name} holds the placeholder {PLACEHOLDER}: write the repository's public address in its place"


def stale(root: Path) -> Iterator[str]:
    """Yield the long targets that are older than the code that they judge."""
    command = [sys.executable, str(root / "scripts" / "evidence.py"), "status", "--check"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        old = [line.split()[0] for line in done.stdout.splitlines() if " fresh " not in line]
        yield f"older than the code that they judge: {' '.join(old)}; run make evidence NAMES=…"


def git(root: Path, *words: str) -> str:
    """Return the output of git."""
    return subprocess.run(
        ["git", *words], cwd=root, check=True, capture_output=True, text=True
    ).stdout.strip()


def build(folder: Path) -> list[Path]:
    """The wheel, the sdist and the wheel of the executive alone, made in a folder."""
    build = [sys.executable, "-m", "hatchling", "build", "-d", str(folder.resolve())]
    subprocess.run(build, cwd=ROOT, check=True)
    subprocess.run([*build, "-t", "wheel"], cwd=ROOT / "executive", check=True)
    return sorted(folder.iterdir())


def pythons(wanted: Sequence[str]) -> list[str]:
    """Return the interpreters that run here: those that are wanted, else each supported version that is found."""
    found = []
    for name in wanted or PYTHONS:
        path = shutil.which(name)
        runs = (
            path
            and not subprocess.run(
                [path, "-c", "import venv"], check=False, capture_output=True
            ).returncode
        )
        if runs:
            found.append(name)
        elif wanted:
            raise SystemExit(
                f"{name}: no such Python runs here; name one that does, as {sys.executable}"
            )
        else:
            sys.stdout.write(f"{name} is not found: nothing is tried with it\n")
    return found or [sys.executable]


def try_out(package: Path, python: str, folder: Path, shared: bool) -> bool:
    """Install a package in an environment of its own and use it there."""
    folder.mkdir()
    (folder / "two.campaign.yaml").write_text(CAMPAIGN, "utf-8")
    environment = folder / "env"
    tried_here = TRIED_ALONE if package.name.startswith("pomona_executive") else TRIED
    subprocess.run([python, "-m", "venv", str(environment)], check=True)
    words = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    if shared:
        (site,) = environment.glob("lib/*/site-packages")
        places = [place for place in sys.path if place.endswith("site-packages")]
        (site / "shared.pth").write_text("\n".join(places))
        words += ["--no-deps", "--no-build-isolation"]
    commands = [("python", *words, str(package)), *(("pomona", *tried) for tried in tried_here)]
    for command, *rest in commands:
        sys.stdout.write(f"  {package.name}, {Path(python).name}: {command} {' '.join(rest)}\n")
        sys.stdout.flush()
        done = subprocess.run(
            [str(environment / "bin" / command), *rest],
            cwd=folder,
            check=False,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            sys.stdout.write(f"{done.stdout}{done.stderr}\n")
            return False
    return True


def main() -> int:
    """Judge, build, try, tag; 0 when all went well."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--tag", action="store_true", help="tag this commit when everything went well"
    )
    parser.add_argument("--shared", action="store_true", help="share the installed packages")
    parser.add_argument(
        "--python", action="append", default=[], help="try with this Python; may be repeated"
    )
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist", help="where wheel and sdist go; must not exist"
    )
    options = parser.parse_args()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    found = [*problems(ROOT, version), *stale(ROOT), *(placeholders(ROOT) if options.tag else ())]
    if options.out.exists():
        found.append(f"{options.out} is there already")
    for problem in found:
        sys.stdout.write(f"{problem}\n")
    if found:
        return 2
    tried = [sys.executable] if options.shared else pythons(options.python)
    packages = build(options.out)
    with tempfile.TemporaryDirectory() as folder:
        for number, (python, package) in enumerate(itertools.product(tried, packages)):
            if not try_out(package, python, Path(folder) / str(number), options.shared):
                return 1
    if options.tag:
        git(ROOT, "tag", "--annotate", f"v{version}", "--message", f"Pomona {version}")
        sys.stdout.write(f"tagged v{version}; push it: git push origin v{version}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
