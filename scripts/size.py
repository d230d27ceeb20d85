"""Print the size and the language of the code, and compare them with bounds that only fall.

    python scripts/size.py             # the table
    python scripts/size.py --check     # 1 when a figure is above its bound in scripts/size.json
    python scripts/size.py --lower     # lower the bounds in scripts/size.json to the figures

Lines are those of Python files without tests, benchmarks and scripts. A leaf is a folder of `pomona/tools`,
`pomona/devices` or `pomona/applications`; the rest is the core. The word rates count per 1 000 words of docstrings with
comments, and of the site: the README and docs/*.md without evidence and reports, written by hand. scripts/walks.py
measures the files that a run passes through.
"""

from __future__ import annotations

import ast
import io
import json
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BOUNDS = Path(__file__).with_name("size.json")
PACKAGES = ("executive", "skills", "drivers")
SHORT, MANY_PARAMETERS = 40, 8
SMALL, MANY_PORTS = 60, 8
LEAVES = ("tools", "devices", "applications")
EVIDENCE = ("evidence", "reports")  # as exclude_docs of mkdocs.yml
LEAF_IMPORT = re.compile(
    r"^\s*(?:from|import) pomona\.(?:tools|devices|applications)\b", re.MULTILINE
)
WORDS = {
    "what": re.compile(r"\bwhat(?:ever)?\b", re.IGNORECASE),
    "told/said/says": re.compile(r"\b(?:told|tells?|says?|said)\b", re.IGNORECASE),
    "nobody/somebody": re.compile(r"\b(?:nobody|somebody|whoever)\b", re.IGNORECASE),
}


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 when `--check` finds a figure above its bound."""
    found = figures()
    bounds: dict[str, float] = json.loads(BOUNDS.read_text("utf-8")) if BOUNDS.is_file() else {}
    above = [name for name, number in found.items() if number > bounds.get(name, float("inf"))]
    for name, number in found.items():
        mark = "  above its bound" if name in above else ""
        sys.stdout.write(
            f"{name:32} {number:>9,.6g}   bound {bounds.get(name, number):>9,.6g}{mark}\n"
        )
    if "--lower" in arguments:
        lower = {
            name: min(found.get(name, bound), bound) for name, bound in (bounds or found).items()
        }
        BOUNDS.write_text(json.dumps(lower, indent=1) + "\n", encoding="utf-8")
    return 1 if above and "--check" in arguments else 0


def figures() -> dict[str, float]:
    """Return each figure by its name."""
    counted: Counter[str] = Counter()
    parts: Counter[str] = Counter()
    texts: list[str] = []
    for path in tracked("*.py"):
        if path.parts[0] in PACKAGES:
            text = (ROOT / path).read_text("utf-8")
            counted.update(of_module(text, texts))
            parts.update(of_part(path, text))
    pages = [path for path in tracked("*.md") if is_document(path)]
    documents = [(ROOT / path).read_text("utf-8") for path in pages]
    found: dict[str, float] = {name: counted[name] for name in NAMES}
    found.update(sorted(parts.items()))
    found["words of the site"] = sum(len(text.split()) for text in documents)
    found["decisions in the site"] = sum(path.parts[1:2] == ("decisions",) for path in pages)
    for kind, corpus in (("docstrings", " ".join(texts)), ("docs", " ".join(documents))):
        words = len(re.findall(r"[A-Za-z]+", corpus))
        for name, pattern in WORDS.items():
            found[f"{name} per 1000 words of {kind}"] = round(
                1000 * len(pattern.findall(corpus)) / words, 2
            )
    return found


NAMES = (
    "lines", "docstring lines", "comments", "short modules", "long parameter lists", "fmt: skip", "module constants",
)  # fmt: skip


def of_part(path: Path, text: str) -> Counter[str]:
    """Count a module for its part of the house: a core, or a leaf; in the core also imports of leaves."""
    floor, _, kind, leaf = path.parts[:4]
    lines = text.count("\n")
    if kind in LEAVES:
        return Counter({f"{kind}/{leaf}: lines": lines})
    counted = Counter({f"{part}: {figure}": number for part in ("core", floor) for figure, number in (
        ("lines", lines), ("files", 1), (f"files under {SMALL} lines", lines < SMALL))})  # fmt: skip
    counted["core: imports of leaves"] = len(LEAF_IMPORT.findall(text))
    if kind == "skills" and len(path.parts) == 4:
        counted[f"skills with more than {MANY_PORTS} inputs"] = sum(
            1
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef) and inputs(node) > MANY_PORTS
        )
    return counted


def inputs(function: ast.FunctionDef) -> int:
    """Return how many ports a skill's `run` declares; 0 for another function."""
    arguments = (*function.args.args, *function.args.kwonlyargs)
    return sum(1 for each in arguments if each.arg != "self") if function.name == "run" else 0


def of_module(text: str, docstrings: list[str]) -> Counter[str]:
    """Count in one module; its docstrings, texts below constants and comments are appended to `docstrings`."""
    lines = text.count("\n")
    counted = Counter(
        {"lines": lines, "short modules": lines < SHORT, "fmt: skip": text.count("fmt: skip")}
    )
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    docstrings.extend(
        comments := [token.string for token in tokens if token.type == tokenize.COMMENT]
    )
    counted["comments"] = len(comments)
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            counted["docstring lines"] += (node.end_lineno or node.lineno) - node.lineno + 1
            docstrings.append(node.value.value)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            names = [
                argument.arg
                for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
            ]
            counted["long parameter lists"] += (
                len([name for name in names if name != "self"]) >= MANY_PARAMETERS
            )
        if isinstance(node, ast.Module):
            counted["module constants"] += sum(map(is_constant, node.body))
    return counted


def is_constant(node: ast.stmt) -> bool:
    """Return True for `NAME = …` or `NAME: type = …` with a name in capitals."""
    targets = (
        node.targets
        if isinstance(node, ast.Assign)
        else [node.target]
        if isinstance(node, ast.AnnAssign)
        else []
    )
    return any(
        isinstance(target, ast.Name) and target.id.upper() == target.id for target in targets
    )


def is_document(path: Path) -> bool:
    """Return True for the README and the pages of docs/, without evidence."""
    if path.parts[0] != "docs":
        return path.name == "README.md" and len(path.parts) == 1
    return path.parts[1] not in EVIDENCE


def tracked(pattern: str) -> Iterator[Path]:
    """Yield the files under version control that match a pattern, relative to the repository."""
    done = subprocess.run(
        ["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True, check=True
    )
    yield from map(Path, done.stdout.splitlines())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
