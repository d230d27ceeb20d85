"""What the check of an older text knows of nodes that went over from it into the text that is checked.

A node is as it was when it is the same with everything below, the same surrounds it, every name that it reads means
what it meant, and nothing was wrong with it. Nodes that call what may have changed, a subtree, are always checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.scope import Named, Resolved, Scope
from pomona.executive.nodes.surroundings import Around


@dataclass(slots=True, eq=False)
class CheckedBefore:
    """One definition as it was.

    Attributes:
        scope: its names.
        resolved: what its layers were looked up to, by id of the node and word of the layer.
        changed: names that mean something else now.
    """

    scope: Scope | None = None
    resolved: Mapping[tuple[int, str], Resolved] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)

    def compare(self, scope: Scope) -> None:
        """See which names mean something else; all that the nodes write are declared by now."""
        if self.scope is not None:
            old, new = self.scope.names, scope.names
            self.changed = {name for name in old if name not in new or not _means_the_same(old[name], new[name])}

    def found_in(self, node: TreeNode) -> Iterator[tuple[tuple[int, str], Resolved]]:
        """What the layers of a node and of all below were looked up to."""
        for below in node.walk():
            for layer in below.layers:
                found = self.resolved.get(key := (id(below), layer.key))
                if found is not None:
                    yield key, found

    def stays(self, node: TreeNode, around: Around) -> bool:
        """Whether a check would find what it found."""
        if self.scope is None or self.scope.around.get(id(node)) != around:
            return False
        return not self.changed or not any(
            read.name in self.changed for _, found in self.found_in(node) for read in found.reads
        )

    def keep(self, node: TreeNode, scope: Scope, resolved: dict[tuple[int, str], Resolved]) -> None:
        """Take over what was found in a node that stays."""
        assert self.scope is not None
        scope.looks = scope.looks or self.scope.looks
        for below in node.walk():
            if id(below) in self.scope.around:
                scope.around[id(below)] = self.scope.around[id(below)]
        for key, found in self.found_in(node):
            resolved[key] = found
            for read in found.reads:
                scope.names[read.name].read = True


def _means_the_same(old: Named, new: Named) -> bool:
    alike = old.type == new.type and old.origin == new.origin and old.may_be_none == new.may_be_none
    return alike and (old.value is new.value or repr(old.value) == repr(new.value))


def checked_before(
    definition: Definition, scopes: Iterable[Scope], resolved: Mapping[tuple[int, str], Resolved]
) -> CheckedBefore:
    """What an older check knows of the definition that stood in this one's place."""
    same = (s for s in scopes if _place(s.definition) == _place(definition))
    return CheckedBefore(next(same, None), resolved)


def _place(definition: Definition) -> tuple[str, str | None]:
    return definition.file.source.path, None if definition.main else definition.name
