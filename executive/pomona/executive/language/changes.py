"""Changes of a tree while it runs: another value for an input of a skill, and a changed tree file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree
from pomona.executive.language.interface import value_of
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Source, did_you_mean


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
    value, problem, hint = value_of(Source("change", text), found)
    if problem:
        raise ChangeRefusedError(f"{port}: {problem.format('it')}{hint and f' ({hint})'}")
    if not found.accepts(value):
        raise ChangeRefusedError(f"{port} does not accept {text[:60]}")
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
