"""Take each leaf out in turn (folder, entry points, tests), and run the rest.

    python scripts/without_leaves.py                  # every leaf; goes on where it was stopped
    python scripts/without_leaves.py tools/groot …    # these
    python scripts/without_leaves.py --full …         # with all quick tests, not only those that read the whole house

With a leaf go the leaves that import it. Each trial runs in a copy of what is committed, in an environment of its own
that shares the installed packages. The copy stays in runs/without_leaves with its compiled files.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DONE = ROOT / "runs" / "without_leaves.json"
COPY = ROOT / "runs" / "without_leaves"
FLOORS = ("executive", "skills", "drivers")
KINDS = ("tools", "devices", "applications")
WHOLE_HOUSE = (
    *("tests/executive/language", "tests/drivers/cell"),
    *("tests/executive/test_cli.py", "tests/executive/test_registry.py", "tests/executive/cell"),
    *("tests/test_leaves.py", "tests/test_names.py", "tests/test_documented.py"),
    *("tests/test_public_api.py", "tests/test_glossary.py", "tests/test_examples.py"),
)
"""Tests that read trees, cells, commands, entry points and documents of the whole house."""
QUICK = "not slow and not long and not realtime"


def leaves(root: Path) -> dict[str, Path]:
    """Return the folder of each leaf by `kind/name`, relative to a checkout."""
    return {
        f"{kind}/{page.parent.name}": page.parent.relative_to(root)
        for kind in KINDS
        for page in sorted(root.glob(f"*/pomona/{kind}/*/__init__.py"))
    }


def with_dependents(root: Path, leaf: str) -> list[str]:
    """Return a leaf and all leaves that import it, directly or through another one."""
    folders = leaves(root)
    texts = {
        name: "\n".join(path.read_text("utf-8") for path in (root / folder).rglob("*.py"))
        for name, folder in folders.items()
    }
    taken = [leaf]
    for each in taken:
        kind, name = each.split("/")
        imported = re.compile(rf"^\s*(?:from|import) pomona\.{kind}(?:\.| import ){name}\b", re.M)
        taken += [
            other for other, text in texts.items() if imported.search(text) and other not in taken
        ]
    return taken


def take_out(root: Path, taken: Sequence[str]) -> None:
    """Remove leaves from a checkout: their folders and tests; their entry points become comments, which tests read."""
    folders = leaves(root)
    project = root / "pyproject.toml"
    text = project.read_text("utf-8")
    for name in taken:
        shutil.rmtree(root / folders[name])
        shutil.rmtree(root / "tests" / folders[name].parts[0] / Path(name), ignore_errors=True)
        module = "pomona." + name.replace("/", ".")
        entries = rf'^([\w.-]+ = "{re.escape(module)}[.:][^"\n]*"[^\n]*)\n'
        text = re.sub(entries, r"# taken out: \1\n", text, flags=re.M)
        text = re.sub(rf'"{re.escape(module)}(?:\.\*)?"(?:, )?', "", text)
    project.write_text(text, encoding="utf-8")


def install(root: Path) -> Path:
    """Make an environment that shares the packages installed here but sees this checkout; return its Python."""
    environment = root / ".venv"
    shutil.rmtree(environment, ignore_errors=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    site = environment / "lib" / version / "site-packages"
    shared = [folder for folder in sys.path if folder.endswith("site-packages")]
    lines = [*(str(root / floor) for floor in FLOORS), *shared]
    (site / "shared.pth").write_text("\n".join(lines) + "\n", encoding="utf-8")
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    installed = site / f"pomona-{project['version']}.dist-info"
    installed.mkdir()
    metadata = f"Metadata-Version: 2.1\nName: pomona\nVersion: {project['version']}\n"
    (installed / "METADATA").write_text(metadata, encoding="utf-8")
    groups = {"console_scripts": project["scripts"], **project["entry-points"]}
    written = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in groups.items()
    ]
    (installed / "entry_points.txt").write_text("\n".join(written), encoding="utf-8")
    return environment / "bin" / "python"


def trial(leaf: str, is_full: bool) -> str:
    """Return how the tests end without a leaf: an empty text when they pass, else their last lines."""
    root = copy()
    taken = with_dependents(root, leaf)
    sys.stdout.write(f"without {', '.join(taken)} … ")
    sys.stdout.flush()
    take_out(root, taken)
    python = install(root)
    parts = ["tests"] if is_full else [part for part in WHOLE_HOUSE if (root / part).exists()]
    commands: list[list[str]] = [
        [str(python), "-m", "pytest", "-n", "2", "-m", QUICK, *parts],
        [str(python), "-m", "pytest", "-p", "no:xdist", "--collect-only", "-m", QUICK],
    ]
    for command in commands:
        done = subprocess.run(command, cwd=root, capture_output=True, text=True)
        if done.returncode:
            return "\n".join(failures(done.stdout + done.stderr))
    return ""


def copy() -> Path:
    """Return a copy of what is committed, without changes of an earlier trial."""
    if not COPY.is_dir():
        subprocess.run(["git", "clone", "--quiet", "--shared", ROOT, COPY], check=True)
    for command in (
        "fetch --quiet origin HEAD",
        "reset --quiet --hard FETCH_HEAD",
        "clean --quiet -d --force",
    ):
        subprocess.run(["git", *command.split()], cwd=COPY, check=True)
    return COPY


def failures(output: str) -> Iterator[str]:
    """Yield the lines of a run of pytest that name what failed."""
    found = [line for line in output.splitlines() if re.match(r"(FAILED|ERROR) ", line)]
    yield from found or output.splitlines()[-5:]


def main(arguments: Sequence[str]) -> int:
    """Try each leaf that has not passed at this commit; return 1 when one does not pass."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("leaves", nargs="*", metavar="KIND/NAME")
    parser.add_argument("--full", action="store_true", help="run all quick tests")
    options = parser.parse_args(arguments)
    known = leaves(ROOT)
    if unknown := [leaf for leaf in options.leaves if leaf not in known]:
        sys.stderr.write(f"no leaf {', '.join(unknown)}; there are {', '.join(known)}\n")
        return 2
    commit = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()
    kept = json.loads(DONE.read_text("utf-8")) if DONE.is_file() else {}
    passed: list[str] = kept.get(commit, [])
    wrong = 0
    for leaf in options.leaves or [leaf for leaf in known if leaf not in passed]:
        reason = trial(leaf, options.full)
        sys.stdout.write(f"{reason or 'the rest passes'}\n")
        if reason:
            wrong += 1
        else:
            passed.append(leaf)
            DONE.parent.mkdir(exist_ok=True)
            DONE.write_text(json.dumps({commit: passed}), encoding="utf-8")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
