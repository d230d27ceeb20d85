"""Candidates: single changes that may cure a failed run, the most likely and smallest first.

Pure: a checked tree and the evidence of a record in, changes out. The weights are assumptions about where causes lie;
`make bench-cures` measures how often the right cause comes first.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.scope import Named, Resolved
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import Port
from pomona.executive.reasons import DEEPEST_CAUSE, failure_codes
from pomona.tools.library.cures.change import SingleChange
from pomona.tools.library.cures.evidence import FailedNode, RunEvidence
from pomona.tools.library.cures.knobs import Knob, Knobs
from pomona.tools.library.cures.other_values import OtherValue, other_values

OWN = 0.6  # a port of the node that failed
MODIFIER = 1.5  # the modifier that failed itself, such as a timeout
TRIES = 0.5  # the count of a retry that used all its tries
WRITER = 0.4  # of a node that wrote an input, relative to the node that read it
RAN = 0.04  # any other node that ran
OPTION = 0.05  # an option of the cell
REMEDY = 5.0  # factor of a port that the code's remedy names
GIVEN = 5.0  # factor of a value with which the run was started, in place of the tree's or the cell's own
UNWRITTEN = 0.4  # factor of a default: a value that somebody wrote is more often wrong
LEAST = 0.01  # weights below are not followed further
"""Weights of the relations between a place and a failure [-]: assumptions, see the module's text."""

_VERBS = {
    1: ("raise", "widen", "longer", "more", "enlarge", "increase", "higher"),
    -1: ("lower", "reduce", "decrease", "less", "narrow", "smaller"),
}
_QUOTED = re.compile(r"(?:did you mean |known: |there is |it has )'?([A-Za-z_][A-Za-z0-9_]*)'?")


@dataclass(frozen=True, slots=True)
class CureCandidate:
    """A change, how likely it is a cure relative to the others, and why it is one."""

    change: SingleChange
    likely: float
    why: str


@dataclass(frozen=True, slots=True)
class _Blame:
    """Why a place may be the cause."""

    knob: Knob
    weight: float
    direction: int
    why: str


def candidates(knobs: Knobs, evidence: RunEvidence) -> list[CureCandidate]:
    """Return single changes that may cure the run, each once, the most likely and smallest first."""
    search = _Search(knobs, evidence)
    search.run()
    found: dict[tuple[str, str, int, str], CureCandidate] = {}
    for blame in search.blamed.values():
        for other, why in _others(blame, evidence):
            change = blame.knob.changed(other.text, other.size)
            candidate = CureCandidate(change, blame.weight * other.share, why)
            key = (change.name, change.path, change.line, change.after)
            if key not in found or found[key].likely < candidate.likely:
                found[key] = candidate
    return sorted(
        found.values(),
        key=lambda c: (-round(c.likely, 6), c.change.size, c.change.path, c.change.line),
    )


@dataclass(frozen=True, slots=True)
class RemedyHint:
    """Knowledge about a port: +1 to raise it, -1 to lower it, 0 unknown; and the factor of its weight."""

    direction: int
    factor: float = REMEDY


Hints = Mapping[str, RemedyHint]


def hints(code: str) -> Hints:
    """Return the names in a failure code's remedy, each with the direction of the last verb before it."""
    known = failure_codes().get(code)
    found: dict[str, RemedyHint] = {}
    for match in re.finditer(r"`([a-z_]+)`", known.remedy if known is not None else ""):
        words = (
            re.findall(r"[a-z]+", known.remedy[: match.start()].lower())
            if known is not None
            else []
        )
        verbs = [
            sign for word in words for sign, known_verbs in _VERBS.items() if word in known_verbs
        ]
        found.setdefault(match[1], RemedyHint(verbs[-1] if verbs else 0))
    return found


def _others(blame: _Blame, evidence: RunEvidence) -> Iterator[tuple[OtherValue, str]]:
    knob = blame.knob
    for other in other_values(knob.text, knob.port, knob.default, blame.direction):
        back = knob.given and other.text == knob.default
        yield (
            replace(other, share=other.share * (GIVEN if back else 1.0)),
            ("the run was started with another value" if back else blame.why),
        )
    if knob.port.type is str or knob.kind == "option":
        for failed in evidence.failed():
            for word in _QUOTED.findall(failed.message):
                if word != knob.text:
                    yield OtherValue(word, 1.0, BY_MESSAGE), "the failure's message names it"


BY_MESSAGE = 2.0  # share of a word that the failure's message offers for a text [-]: an assumption


@dataclass(frozen=True, slots=True)
class _Trail:
    """The way from a failure to a place: the weight that is left, the reason, hints, and whether writers follow."""

    weight: float
    why: str
    hinted: Hints = field(default_factory=dict)
    follow: bool = True


@dataclass(slots=True, eq=False)
class _Search:
    knobs: Knobs
    evidence: RunEvidence
    blamed: dict[tuple[str, str, int, int], _Blame] = field(default_factory=dict)
    followed: dict[int, float] = field(default_factory=dict)
    calls: dict[int, list[tuple[TreeNode, Resolved]]] = field(
        default_factory=dict
    )  # of each definition, by its id
    paths: dict[str, tuple[TreeNode, str]] = field(
        default_factory=dict
    )  # node and word of a run's path

    def run(self) -> None:
        """Follow each failure to the places behind it, then take the others that may matter."""
        for node in self.knobs.nodes():
            for _, found in self.knobs.layers(node):
                if found.subtree is not None:
                    self.calls.setdefault(id(found.subtree), []).append((node, found))
        self.paths = self._paths()
        for failed in self.evidence.failed():
            self._failure(failed)
        for path, tries in self.evidence.exhausted.items():
            self._modifier(path, TRIES / tries**0.5, 1, f"all tries were used: {tries}")
        for path in self.evidence.ran:
            if path in self.paths:
                self._node(self.paths[path][0], _Trail(RAN, "it ran", follow=False))
        settings = self.knobs.settings
        for name in self.knobs.analysis.document.main.parameters:
            self._blame(
                self.knobs.parameter(name),
                _Trail(GIVEN * RAN if name in settings else RAN, "a parameter"),
            )
        for option in self.knobs.options:
            weight = GIVEN * OPTION if option.name in settings else OPTION
            self._blame(self.knobs.option(option.name), _Trail(weight, "an option of the cell"))

    def _paths(self) -> dict[str, tuple[TreeNode, str]]:
        """Return node and word by the paths of the record, which names the file and line of each."""
        written: dict[tuple[str, int], list[TreeNode]] = {}
        for node in self.knobs.nodes():
            written.setdefault((node.key.source.path, node.key.line), []).append(node)
        found: dict[str, tuple[TreeNode, str]] = {}
        for facts in self.evidence.started.nodes if self.evidence.started is not None else ():
            path = str(facts.get("path"))
            kind = str(facts.get("kind"))
            names = (
                path.rsplit("/", 1)[-1].partition(":")[0].partition("#")[0],
                str(facts.get("name")),
            )
            here = written.get((str(facts.get("file")), _whole(facts.get("line"))), [])
            fitting = [n for n in here if n.label in names] or [
                n for n in here if kind in (n.kind, *n.decorators)
            ]
            if fitting:
                found[path] = (fitting[0], kind)
        return found

    # ------------------------------------------------------------------------------------------- failures

    def _failure(self, failed: FailedNode) -> None:
        if failed.path not in self.paths:
            return
        node, kind = self.paths[failed.path]
        trail = _Trail(
            OWN * failed.weight, f"{node.label} failed with {failed.code}", hints(failed.code)
        )
        if kind in node.decorators:
            direction = 1 if failed.code == "TIMEOUT" else 0
            self._modifier(failed.path, MODIFIER * failed.weight, direction, trail.why)
            trail = replace(
                trail, hinted={}
            )  # the remedy is about the modifier: a planner's `budget` is not meant
        self._node(node, trail)

    def _modifier(self, path: str, weight: float, direction: int, why: str) -> None:
        """Blame the words of one modifier, at a path of the record."""
        if path not in self.paths:
            return
        node, kind = self.paths[path]
        for layer, found in self.knobs.layers(node):
            if layer.key == kind:
                for slot in self.knobs.slots(layer, found):
                    hinted = {slot: RemedyHint(direction, 1.0)}
                    self._slot(node, layer, slot, _Trail(weight, why, hinted, follow=False))

    def _node(self, node: TreeNode, trail: _Trail) -> None:
        """Blame all inputs of a node, and the nodes that wrote them."""
        if trail.weight < LEAST or (
            trail.follow and self.followed.get(id(node), 0.0) >= trail.weight
        ):
            return
        if trail.follow:
            self.followed[id(node)] = trail.weight
        for layer, found in self.knobs.layers(node):
            here = trail if layer is node.type else replace(trail, weight=RAN)
            for slot in self.knobs.slots(layer, found):
                self._slot(node, layer, slot, here)
            if trail.follow and found.skill is None and found.subtree is None:
                for read in found.reads:  # those of conditions too, which belong to no port
                    self._name(self.knobs.owner[id(node)], read.name, here)

    def _slot(self, node: TreeNode, layer: NodeType, slot: str, trail: _Trail) -> None:
        """Blame the value of a port or a word; a wired one: the places behind the wire."""
        found = self.knobs.analysis.resolved[id(node), layer.key]
        knob = self.knobs.slot(node, layer, found, slot)
        if knob is not None:
            self._blame(knob, trail)
            return
        for read in found.reads:
            if read.slot == slot:
                wired = {read.name: trail.hinted[slot]} if slot in trail.hinted else trail.hinted
                self._name(self.knobs.owner[id(node)], read.name, replace(trail, hinted=wired))

    def _name(self, definition: Definition, name: str, trail: _Trail) -> None:
        """Blame the places and nodes that give a name its value."""
        named: Named | None = self.knobs.analysis.scopes[id(definition)].names.get(name)
        if named is None or trail.weight < LEAST:
            return
        if named.origin == "parameter":
            self._blame(self.knobs.parameter(name), trail)
        elif named.origin == "constant":
            self._blame(self.knobs.declared(definition.file.constants[name], Port(object)), trail)
        elif named.origin == "input":
            for node, found in self.calls.get(id(definition), ()):
                if name in self.knobs.slots(node.type, found):
                    self._slot(node, node.type, name, trail)
        elif trail.follow:
            for writer in self._writers(definition, name):
                why = f"{writer.label} wrote '{name}' for it: {trail.why}"
                self._node(writer, replace(trail, weight=trail.weight * WRITER, why=why))

    def _writers(self, definition: Definition, name: str, depth: int = 0) -> Iterator[TreeNode]:
        """Yield the nodes that write a name, those of called subtrees included."""
        for node in (
            definition.root.walk() if definition.root is not None and depth < DEEPEST_CAUSE else ()
        ):
            for _, found in self.knobs.layers(node):
                for port, target in found.outputs.items():
                    if target != name:
                        continue
                    yield node
                    if found.subtree is not None:
                        yield from self._writers(found.subtree, port, depth + 1)

    # ------------------------------------------------------------------------------------------- places

    def _blame(self, knob: Knob | None, trail: _Trail) -> None:
        if knob is None:
            return
        hint = trail.hinted.get(knob.slot, RemedyHint(0, UNWRITTEN if knob.unwritten else 1.0))
        weight = trail.weight * hint.factor
        key = knob.path, knob.setting or knob.name, knob.line, knob.start
        if key not in self.blamed or self.blamed[key].weight < weight:
            why = (
                f"{trail.why}; the remedy names `{knob.slot}`"
                if hint.factor == REMEDY
                else trail.why
            )
            self.blamed[key] = _Blame(knob, weight, hint.direction, why)


def _whole(value: object) -> int:
    """Return a line's number; 0 for anything else, which only a forged record holds."""
    return value if isinstance(value, int) else 0
