"""What `pomona new` writes: files of the folder `templates`, under other names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True, slots=True)
class PieceNames:
    """The names of a piece that is written.

    Attributes:
        small: such as `weigh_fruit`.
        capital: of its class, such as `WeighFruit`.
        module: the package that holds it.
    """

    small: str
    capital: str
    module: str = ""


@dataclass(frozen=True, slots=True)
class Piece:
    """The files that `pomona new WORD name` writes.

    Attributes:
        name: name in the templates, in small letters; with capitals it is a class.
        templates: paths in the templates, below one folder; `my_package` is the package that code belongs to.
        entry: group, name and object of its entry point; empty for data.
    """

    name: str
    templates: tuple[str, ...]
    entry: tuple[str, ...] = ()

    def renamed(self, text: str, names: PieceNames) -> str:
        """Return a text of the templates with other names."""
        words = {
            "my_package": names.module,
            self.name: names.small,
            capitals(self.name): names.capital,
        }
        return re.sub("|".join(words), lambda found: words[found[0]], text)

    def files(self, names: PieceNames, into: Path) -> dict[Path, bytes]:
        """Return the contents of its files in a folder, renamed."""
        found = {}
        for path in self.templates:
            data = (TEMPLATES / path).read_bytes()
            if not path.endswith(".ply"):
                data = self.renamed(data.decode(), names).encode()
            found[into / self.renamed(path.partition("/")[2], names)] = data
        return found


def capitals(name: str) -> str:
    """Return the name of a class: `wall_camera` is `WallCamera`."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


def _code(name: str, group: str, entry: str, target: str, *more: str) -> Piece:
    files = f"package/my_package/{name}.py", f"package/tests/test_{name}.py", *more
    return Piece(name, files, (group, entry, f"my_package.{name}:{target}"))


def _driver(name: str, *more: str) -> Piece:
    return _code(name, "pomona.drivers", name, "connect", *more)


SKILL = _code("hover", "pomona.skills", "Hover", "Hover")
KINDS: Mapping[str, Piece] = {
    "skill": SKILL,
    "node": _code("lenient", "pomona.nodes", "lenient", "LenientType"),
}
"""Kinds that the executive alone can begin."""
KINDS_ELSEWHERE: Mapping[str, Piece] = {
    "driver": _driver("wall_camera"),
    "gripper": _driver("clamp", "package/cells/clamp.yaml", "package/cells/clamp_tree.yaml"),
    "arm": _driver("reacher"),
    "cell": Piece("bench", ("cell/bench.yaml",)),
    "fruit": Piece("plum", ("fruit/plum/fruit.yaml", "fruit/plum/plum.ply")),
}
"""Kinds of the distribution `pomona`."""

PACKAGE = Piece(
    "my_package",
    (
        "package/pyproject.toml",
        "package/README.md",
        "package/my_package/__init__.py",
        "package/my_package/py.typed",
    ),
)
EXAMPLE_TREE = Piece(
    "hover", ("package/trees/my_package.yaml", "package/trees/my_package_test.yaml")
)
OWN_TREE = Piece("look_around", ("tree/look_around.yaml",))
EMPTY_TREE = Piece("look_around", ("alone/look_around.yaml",))
"""A tree to begin with where no skill is installed."""
