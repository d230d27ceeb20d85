"""Changes of a tree while it runs: another value for an input of a skill, and a changed tree file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.values import out_of_range
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Findings, Source, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar, read_yaml


class ChangeRefusedError(PomonaError):
    """No such skill or input, or no value for it."""


class ReloadRefusedError(PomonaError):
    """A change of the file that the run does not take over; nothing was taken over."""


def changed_input(tree: BuiltTree, path: str, port: str, text: str) -> Any:
    """Return the value that `text` means for this input of the skill at this path.

    Raises ChangeRefusedError: there is no such skill or input, or this is no value for it.
    """
    skill = tree.behaviours.get(path)
    if not isinstance(skill, Skill):
        raise ChangeRefusedError(f"there is no skill at {path}")
    found = skill.inputs.get(port)
    if found is None:
        hint = did_you_mean(port, skill.inputs) or f"it has {', '.join(skill.inputs) or 'none'}"
        raise ChangeRefusedError(f"{skill.name} has no input '{port}': {hint}")
    source = Source("change", text)
    node: YamlNode | None = YamlScalar(source, 1, 1, 1, len(text) + 1, text, True)
    if text[:1] in ("[", "{"):
        node = read_yaml(source, Findings())
    if node is None:
        raise ChangeRefusedError(f"{port}: this is not YAML: {text[:60]}")
    try:
        value = literal(node, found.type, found.choices)
    except LiteralError as error:
        raise ChangeRefusedError(
            f"{port}: {error.message}{error.hint and f' ({error.hint})'}"
        ) from None
    if not found.accepts(value):
        raise ChangeRefusedError(f"{port} does not accept {text[:60]}")
    problem = out_of_range(value, found)
    if problem:
        raise ChangeRefusedError(f"{port} {problem}")
    return value


def change_input(tree: BuiltTree, detail: str) -> None:
    """Change an input as requested by `port = value ← path`; it applies from the skill's next start on.

    Raises ChangeRefusedError: as `changed_input`.
    """
    said, _, path = detail.rpartition(" ← ")
    port, _, text = said.partition(" = ")
    value = changed_input(tree, path, port, text)
    skill = tree.behaviours[path]
    assert isinstance(skill, Skill)
    skill.changed[port] = value


Around = Mapping[tuple[str, str], Any]  # `BuiltTree.around` of the nodes that stay


class Takeover(Protocol):
    """A changed tree file that a paused run can go on with."""

    fresh: BuiltTree  # the file's tree
    difference: str  # of the files, as a unified diff

    def apply(self, running: BuiltTree) -> BuiltTree:
        """Put its nodes into the run's tree, and return that. Raises ReloadRefusedError: it has changed meanwhile."""
