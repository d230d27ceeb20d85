"""Data flow: is a port written on every path before it is read?

For each node the analysis knows which names are certainly written when the node succeeds, and which when it fails.
`ALL` stands for an end that cannot be reached.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from executive.language.failures import Failures
from executive.language.model import TreeNode
from executive.language.scope import Computed, Read, Resolved


class Names:
    """A set of names, or ALL of them."""

    __slots__ = ("names",)

    def __init__(self, names: frozenset[str] | None) -> None:
        self.names = names

    def __contains__(self, name: str) -> bool:
        return self.names is None or name in self.names

    def __and__(self, other: Names) -> Names:
        if self.names is None:
            return other
        return self if other.names is None else Names(self.names & other.names)

    def __or__(self, other: Names) -> Names:
        if self.names is None or other.names is None:
            return ALL
        return Names(self.names | other.names)

    def plus(self, *names: str) -> Names:
        return self if self.names is None else Names(self.names.union(names))


ALL = Names(None)


@dataclass(frozen=True, slots=True)
class Ends:
    """What is certainly written at a node's two ends."""

    success: Names
    failure: Names


@dataclass(slots=True, eq=False)
class Flow:
    """Follows one definition; `unset(node, read)` is called for each read of what may not be written."""

    resolved: Mapping[int, Resolved]
    failures: Failures
    unset: Callable[[TreeNode, Read], None]

    def node(self, node: TreeNode, before: Names, parent: str = "") -> Ends:
        """Follow a node with its modifiers, from the inside to the outside."""
        found = self.resolved.get(id(node))
        if found is None:
            return Ends(before, before)
        inner = before
        if "for_each" in node.modifiers:
            inner = before.plus(*(found.outputs[name] for name in ("for_each",) if name in found.outputs))
        for read in found.reads:
            if read.slot != "retry_if":
                self.require(node, read, before if read.slot in ("when", "guard", "for_each") else inner)
        ends = self.bare(node, found, inner)
        for name in node.decorators:
            ends = self.wrapped(node, found, name, ends, before, inner, parent)
        return ends

    def require(self, node: TreeNode, read: Read, written: Names) -> None:
        if read.required and read.name not in written:
            self.unset(node, read)

    def wrapped(
        self, node: TreeNode, found: Resolved, name: str, ends: Ends, before: Names, inner: Names, parent: str
    ) -> Ends:
        success, failure = ends.success, ends.failure
        match name:
            case "timeout":
                return Ends(success, failure & inner)
            case "invert":
                return Ends(failure, success)
            case "force":
                both = success & failure
                return Ends(ALL, both) if found.setting("force", "success") == "failure" else Ends(both, ALL)
            case "retry":
                for read in found.reads:
                    if read.slot == "retry_if":
                        self.require(node, read, failure)
                if node.on_failure is not None:
                    recovered = self.node(node.on_failure, failure)
                    failure = recovered.success & recovered.failure
                return Ends(success, failure)
            case "for_each":
                return Ends(before, failure)
            case "guard":
                return Ends(success, failure & before)
            case "when":
                if parent in ("fallback", "reactive_fallback"):
                    return Ends(success, failure & before)
                return Ends(success & before, failure)
            case _:
                return ends

    def bare(self, node: TreeNode, found: Resolved, before: Names) -> Ends:
        match node.kind:
            case "sequence" | "reactive_sequence":
                reached, failure = before, ALL
                for child in node.children:
                    ends = self.node(child, reached, node.kind)
                    reached, failure = ends.success, failure & ends.failure
                return Ends(reached, failure)
            case "fallback" | "reactive_fallback":
                reached, success = before, ALL
                for child in node.children:
                    ends = self.node(child, reached, node.kind)
                    reached, success = ends.failure, success & ends.success
                return Ends(success, reached)
            case "parallel":
                return self.parallel(node, found, before)
            case "recovery" if len(node.children) == 2:
                first = self.node(node.children[0], before, node.kind)
                second = self.node(node.children[1], first.failure, node.kind)
                return Ends(first.success, first.failure & second.failure)
            case "fail":
                return Ends(ALL, before)
            case _:
                values = (*found.inputs.values(), *found.settings.values())
                can_fail = bool(self.failures.bare(node)) or any(isinstance(value, Computed) for value in values)
                return Ends(before.plus(*found.outputs.values()), before if can_fail else ALL)

    def parallel(self, node: TreeNode, found: Resolved, before: Names) -> Ends:
        """Children of a parallel start together: none may count on what another one writes."""
        ends = [self.node(child, before, node.kind) for child in node.children]
        failure = before if any(e.failure is not ALL for e in ends) else ALL
        success_on = found.setting("success_on", "all")
        if success_on == "one":
            success = ALL
            for e in ends:
                success = success & e.success
        else:
            success = before
            for child, e in zip(node.children, ends, strict=True):
                if success_on == "all" or child.label in success_on:
                    success = success | e.success
        return Ends(success, failure)
