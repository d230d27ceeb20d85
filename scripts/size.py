"""Print the size of the whole house beside bounds that only fall and the budgets of its rooms.

    python scripts/size.py             # the table
    python scripts/size.py --check     # 1 when a figure is above its bound in scripts/size.json
    python scripts/size.py --lower     # lower the bounds in scripts/size.json to the figures, or to their goals

Tokens are names, operators, numbers and texts of Python files, without comments and docstrings: denser code gains
nothing. The product is everything that ships (executive, skills, drivers, examples) without the conformance suite,
which has a bound of its own. A leaf is a folder of `pomona/tools`, `pomona/devices` or `pomona/applications`; the rest
is the core. A room is one or more leaves with a budget; the sum is the bound. scripts/walks.py measures the files
that a run passes through.
"""

from __future__ import annotations

import ast
import io
import json
import subprocess
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BOUNDS = Path(__file__).with_name("size.json")
PRODUCT = ("executive", "skills", "drivers", "examples")
CORE = ("executive", "skills", "drivers")
LEAVES = ("tools", "devices", "applications")
CONFORMANCE = ("pomona", "drivers", "conformance")
COUNTED = (
    tokenize.NAME,
    tokenize.OP,
    tokenize.NUMBER,
    tokenize.STRING,
    getattr(tokenize, "FSTRING_START", -1),
    getattr(tokenize, "FSTRING_MIDDLE", -1),
)


@dataclass(frozen=True, slots=True)
class Module:
    """Counts of one Python file."""

    path: Path
    tokens: int
    code_lines: int
    tuple_assignments: int
    settings: int
    attributes: int
    """Instance attributes of the class that has most."""
    ports: int
    """Inputs of the skill that has most."""
    imports_of_leaves: int

    @property
    def part(self) -> str:
        """Return `conformance`, `examples`, the floor of a core module, or `kind/leaf`."""
        if self.path.parts[1:4] == CONFORMANCE:
            return "conformance"
        if len(self.path.parts) > 3 and self.path.parts[2] in LEAVES:
            return f"{self.path.parts[2]}/{self.path.parts[3]}"
        return self.path.parts[0]


@dataclass
class House:
    """All counted modules, and the tokens of each part."""

    modules: list[Module]
    parts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        for module in self.modules:
            self.parts[module.part] += module.tokens

    def most(self, name: str) -> int:
        """Return the largest value of a count over all modules."""
        return max((getattr(module, name) for module in self.modules), default=0)

    def total(self, name: str) -> int:
        """Return the sum of a count over all modules."""
        return sum(getattr(module, name) for module in self.modules)


def main(arguments: Sequence[str]) -> int:
    """Print the table; return 1 when `--check` finds a figure above its bound."""
    kept = json.loads(BOUNDS.read_text("utf-8"))
    bounds: dict[str, float] = kept["bounds"]
    found, rooms = figures(kept["rooms"])
    above = [name for name, number in found.items() if number > bounds.get(name, float("inf"))]
    for name, number in found.items():
        mark = "  above its bound" if name in above else ""
        bound = bounds.get(name, number)
        goal = kept["goals"].get(name)
        aim = "" if goal is None else f"   goal {goal:>9,.6g}"
        sys.stdout.write(f"{name:44} {number:>9,.6g}   bound {bound:>9,.6g}{aim}{mark}\n")
    sys.stdout.write(
        "\nrooms, in tokens; a room may exceed its budget if another gives as much back\n"
    )
    for name, number in sorted(rooms.items(), key=lambda room: -room[1]):
        budget = kept["budgets"].get(name)
        aim = "" if budget is None else f"   budget {budget:>7,}"
        sys.stdout.write(f"{name:44} {number:>9,}{aim}\n")
    if "--lower" in arguments:
        lower = {
            name: min(max(found.get(name, bound) or bound, kept["goals"].get(name, 0)), bound)
            for name, bound in bounds.items()
        }
        kept["bounds"] = lower
        BOUNDS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return 1 if above and "--check" in arguments else 0


def figures(rooms: Mapping[str, Sequence[str]]) -> tuple[dict[str, float], dict[str, int]]:
    """Return each bounded figure by its name, and the tokens of each room."""
    house = House([read(path) for path in tracked("*.py") if path.parts[0] in PRODUCT])
    leaves = {part: tokens for part, tokens in house.parts.items() if "/" in part}
    pages = list(tracked("*.md"))
    words = {path: len((ROOT / path).read_text("utf-8").split()) for path in pages}
    counted = {
        "product: tokens": house.parts.total() - house.parts["conformance"],
        "conformance: tokens": house.parts["conformance"],
        "core: tokens": sum(house.parts[floor] for floor in CORE),
        "core: imports of leaves": house.total("imports_of_leaves"),
        "largest leaf: tokens": max(leaves.values()),
        "benchmarks: tokens": sum(read(path).tokens for path in tracked("benchmarks/*.py")),
        "own JavaScript: lines": javascript_lines(),
        "tuple assignments per 1000 lines of code": round(
            1000 * house.total("tuple_assignments") / house.total("code_lines"), 1
        ),
        "settings": house.total("settings"),
        "most attributes of a class": house.most("attributes"),
        "most ports of a skill": house.most("ports"),
        "groups of entry points with one provider": single_providers(),
        "words: README": words[Path("README.md")],
        "words: all pages but the changelog": sum(
            number for path, number in words.items() if path.name != "CHANGELOG.md"
        ),
        "words: longest README of a leaf": max(
            number for path, number in words.items() if is_leaf_page(path)
        ),
    }
    named = {part for parts in rooms.values() for part in parts}
    found = {room: sum(house.parts[part] for part in parts) for room, parts in rooms.items()}
    found.update({part: tokens for part, tokens in house.parts.items() if part not in named})
    return counted, found


def read(path: Path) -> Module:
    """Count one Python file, given relative to the repository."""
    text = (ROOT / path).read_text("utf-8")
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    is_core = len(path.parts) > 2 and path.parts[2] not in LEAVES
    return Module(
        path=path,
        tokens=tokens(text, nodes),
        code_lines=code_lines(text, nodes),
        tuple_assignments=sum(map(is_tuple_assignment, nodes)),
        settings=sum(is_setting(statement) for each in classes for statement in each.body),
        attributes=max(map(attributes, classes), default=0),
        ports=max(map(ports, classes), default=0),
        imports_of_leaves=sum(map(imports_leaf, nodes)) if is_core else 0,
    )


def tokens(text: str, nodes: Sequence[ast.AST]) -> int:
    """Return the number of names, operators, numbers and texts; docstrings do not count."""
    docstrings = sum(map(is_docstring, nodes))
    read_all = tokenize.generate_tokens(io.StringIO(text).readline)
    return sum(token.type in COUNTED for token in read_all) - docstrings


def code_lines(text: str, nodes: Sequence[ast.AST]) -> int:
    """Return the number of lines that are neither empty, nor a comment, nor part of a docstring."""
    lines = [line.strip() for line in text.splitlines()]
    written = sum(bool(line) and not line.startswith("#") for line in lines)
    return written - sum(
        1 + (node.end_lineno or node.lineno) - node.lineno
        for node in nodes
        if isinstance(node, ast.Expr) and is_docstring(node)
    )


def is_docstring(node: ast.AST) -> bool:
    """Return True for a text that stands alone, as docstrings do."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def is_tuple_assignment(node: ast.AST) -> bool:
    """Return True for `a, b = c, d`: two thoughts in one line."""
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
    )


def is_setting(statement: ast.stmt) -> bool:
    """Return True for a field of a class that a file may set: `name: type = value(...)`."""
    if not isinstance(statement, ast.AnnAssign) or not isinstance(statement.value, ast.Call):
        return False
    return isinstance(statement.value.func, ast.Name) and statement.value.func.id == "value"


def attributes(node: ast.ClassDef) -> int:
    """Return how many different attributes of `self` a class assigns."""
    return len(
        {
            each.attr
            for each in ast.walk(node)
            if isinstance(each, ast.Attribute)
            and isinstance(each.ctx, ast.Store)
            and isinstance(each.value, ast.Name)
            and each.value.id == "self"
        }
    )


def ports(node: ast.ClassDef) -> int:
    """Return how many inputs a skill's `run` declares; 0 for another class."""
    if not any("Skill" in ast.unparse(base) for base in node.bases):
        return 0
    runs = [each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "run"]
    return sum(len(run.args.args) + len(run.args.kwonlyargs) - 1 for run in runs)


def imports_leaf(node: ast.AST) -> bool:
    """Return True for an import of a leaf."""
    names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    return any(name.startswith(tuple(f"pomona.{kind}" for kind in LEAVES)) for name in names)


def javascript_lines() -> int:
    """Return the lines of the project's own JavaScript, without other people's in `vendor`."""
    own = [path for path in tracked("*.js") if path.parts[0] in PRODUCT]
    return sum(
        (ROOT / path).read_text("utf-8").count("\n") for path in own if "vendor" not in path.parts
    )


def single_providers() -> int:
    """Return how many groups of entry points have one provider: provider and caller could join."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return sum(len(entries) == 1 for entries in project["entry-points"].values())


def is_leaf_page(path: Path) -> bool:
    """Return True for the README of a leaf."""
    return path.name == "README.md" and len(path.parts) == 5 and path.parts[2] in LEAVES


def tracked(pattern: str) -> Iterator[Path]:
    """Yield the files under version control that match a pattern, relative to the repository."""
    done = subprocess.run(
        ["git", "ls-files", pattern], cwd=ROOT, capture_output=True, text=True, check=True
    )
    yield from (path for line in done.stdout.splitlines() if (ROOT / (path := Path(line))).exists())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
