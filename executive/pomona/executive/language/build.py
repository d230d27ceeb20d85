"""Document → py_trees tree. Builds only checked documents."""

from __future__ import annotations

from collections import abc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Protocol

import py_trees
from py_trees.behaviour import Behaviour

from pomona.executive.board import Board
from pomona.executive.language.build_scope import (
    InstanceScope,
    bind_skill,
    condition,
    constant,
    getter,
)
from pomona.executive.language.built import BuiltTree, NodeInfo, Side, UniquePaths
from pomona.executive.language.check import Analysis, analyse
from pomona.executive.language.expression_run import Getter
from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.language.scope import Resolved
from pomona.executive.nodes.behaviours import Subtree, WholeTree
from pomona.executive.nodes.facts import Condition
from pomona.executive.nodes.node_type import NodeType, OfLayer
from pomona.executive.nodes.takes import Nothing
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, SkillContext
from pomona.executive.values.findings import Finding, TreeFileError
from pomona.executive.values.yaml_nodes import written


class Mocks(Protocol):
    """Selects the skills that mocks replace."""

    def replace(self, skill: type[Skill], skill_name: str, label: str, path: str) -> Skill | None:
        """Return the mock that stands in for a node's skill, or None to keep the skill."""


def build(
    document: Document,
    skills: Registry,
    *,
    context: SkillContext,
    board: Board | None = None,
    overrides: Mapping[str, str] | abc.Sequence[str] = (),
    interfaces: tuple[type, ...] | None = None,
    mocks: Mocks | None = None,
    around: Mapping[tuple[str, str], Any] = MappingProxyType({}),
) -> BuiltTree:
    """Build a tree from a document, bound to the run `context`.

    Args:
        overrides: values for parameters, as a mapping or as texts `name=value`.
        interfaces: the cell's device interfaces; None skips the check of devices.
        mocks: replaces skills, for dry runs.
        around: counters and failures of nodes that are there already, for nodes inside them: `BuiltTree.around`.

    Raises TreeFileError: the document has errors; all of them are in it.
    """
    analysis = analyse(document, skills, overrides=overrides, interfaces=interfaces)
    main = document.main.main
    errors = analysis.errors
    if main is not None and not errors:
        errors = _inputs_nobody_gives(main)
    if errors or main is None or main.root is None:
        raise TreeFileError(errors)
    board = board if board is not None else Board(context.clock)
    builder = _Builder(analysis, context, board, mocks)
    builder.kept.update(around)
    names: dict[str, Getter] = {
        name: constant(value) for name, value in analysis.parameters.items()
    }
    scope = InstanceScope(analysis, main, board, "/", names)
    root = builder.node(main.root, scope, None, path=document.main.name)
    assert analysis.outcomes is not None
    if analysis.outcomes.of(main.root).skips:
        root = WholeTree(document.main.name, root)
    return BuiltTree(
        document.main.name,
        root,
        tuple(builder.nodes.values()),
        dict(builder.behaviours),
        dict(analysis.parameters),
        board,
        tuple(builder.breakpoints),
        document,
        builder.around,
        "" if document.main.success is None else document.main.success.text,
    )


def _inputs_nobody_gives(main: Definition) -> list[Finding]:
    missing = [declared for declared in main.inputs.values() if declared.default is None]
    message = "is an input that only a calling tree can give: run a tree that calls this one"
    return [
        Finding(
            d.key.source.path,
            d.key.line,
            d.key.column,
            "error",
            "no-value",
            f"'{d.key.text}' {message}",
        )
        for d in missing
    ]


class _Builder:
    def __init__(
        self, analysis: Analysis, context: SkillContext, board: Board, mocks: Mocks | None
    ) -> None:
        self.analysis = analysis
        self.context = context
        self.board = board
        self.mocks = mocks
        self.kept, self.around = dict[tuple[str, str], Any](), dict[tuple[str, str], Any]()
        self.nodes: dict[str, NodeInfo] = {}
        self.behaviours: dict[str, Behaviour] = {}
        self.breakpoints: list[tuple[str, Side]] = []
        self.paths = UniquePaths()

    def node(
        self, node: TreeNode, scope: InstanceScope, parent: str | None, *, path: str
    ) -> Behaviour:
        """Build a node with its modifiers.

        Args:
            parent: path of the node that it is a child of.
            path: its own, unless it is taken.
        """
        return self.layer(node, 0, scope, self.paths.take(path), parent)

    def layer(
        self, node: TreeNode, index: int, scope: InstanceScope, path: str, parent: str | None
    ) -> Behaviour:
        """Build a node without its outer modifiers; in drawing order, outer layers come before inner ones."""
        layer = node.layers[index]
        found = self.analysis.resolved[id(node), layer.key]
        at = LayerBuild(self, node, index, layer, found, scope, path, parent)
        side = layer.pauses(at)
        if side is not None:
            self.breakpoints.append((path, side))
        if not layer.needed(at):
            return at.inside()
        self.nodes[at.own_path] = at.info()
        self.behaviours[at.own_path] = py_trees.behaviours.Dummy(
            at.name
        )  # keeps the place in drawing order
        behaviour = layer.build(at)
        behaviour.path = at.own_path  # type: ignore[attr-defined]
        self.behaviours[at.own_path] = behaviour
        return behaviour


@dataclass(slots=True, eq=False)
class LayerBuild(OfLayer):
    """One layer of a node being built by its type (a `BuildContext`)."""

    builder: _Builder
    node: TreeNode
    index: int
    layer: NodeType
    found: Resolved
    scope: InstanceScope
    path: str  # of the node itself
    parent: str | None  # path of the layer around it

    @property
    def wraps(self) -> bool:
        """Whether this layer is a modifier around the node, not the node itself."""
        return self.layer is not self.node.type

    @property
    def own_path(self) -> str:
        """The layer's path: a modifier's is called after the node that it wraps."""
        return f"{self.path}:{self.layer.key}" if self.wraps else self.path

    @property
    def name(self) -> str:
        if self.wraps and self.layer.named:
            return f"{self.layer.key} {self.node.label}"
        return self.node.label

    @property
    def now(self) -> Callable[[], float]:
        return self.builder.context.elapsed

    def info(self) -> NodeInfo:
        """Return the layer's description for views and records."""
        node = self.node
        layer = self.layer
        source = self.node.at.source
        if self.wraps:
            return NodeInfo(
                self.own_path,
                self.parent,
                layer.key,
                layer.key,
                layer.key,
                file=source.path,
                line=node.at.line,
                end_line=node.at.end_line,
                settings=self.settings(),
                choices=layer.choices(node),
            )
        name = self.path if self.parent is None and node.name is None else node.label
        inputs = {n: written(node.ports[n][1]) for n in self.found.inputs if n in node.ports}
        outputs = {
            n: written(node.ports[n][1])
            for n in self.found.outputs
            if n in node.ports and n not in inputs
        }
        skill = self.found.skill
        mocked = self.stand_in() is not None
        return NodeInfo(
            self.path,
            self.parent,
            layer.key,
            name,
            node.key.text if layer.calls else layer.key,
            node.description,
            node.comment,
            source.path,
            node.at.line,
            node.at.end_line,
            inputs,
            outputs,
            self.settings(),
            tuple(interface.__name__ for interface in skill.devices) if skill is not None else (),
            skill.failures if skill is not None else (),
            mocked,
            layer.choices(node),
            tuple(filter(None, node.leads)),
        )

    def settings(self) -> dict[str, str]:
        """Return the settings of the layer as written, without nodes and wires."""
        found = {}
        for slot, taken in self.layer.slots.items():
            value = self.written(slot)
            if (
                value is not None
                and not taken.nodes
                and not taken.wires
                and not isinstance(taken, Nothing)
            ):
                found[slot] = written(value)
        return found

    # ------------------------------------------------------------------------------------------- values

    def given(self, slot: str) -> bool:
        return slot in self.found.settings

    def value(self, slot: str, default: Any = None, **names: object) -> Getter:
        value = self.found.settings.get(slot)
        return constant(default) if value is None else getter(value, self.inner(names))

    def condition(self, slot: str, **names: object) -> Condition:
        return condition(self.found.settings[slot], self.inner(names))

    def inputs(self) -> dict[str, Getter]:
        return {name: getter(value, self.scope) for name, value in self.found.inputs.items()}

    def writer(self, name: str) -> Callable[[Any], None]:
        write = self.builder.board.write
        key = self.scope.key(self.found.outputs[name])
        path = self.own_path
        return lambda value: write(key, value, path)

    def inner(self, names: Mapping[str, Any]) -> InstanceScope:
        """Return the scope with further names in it."""
        found = {
            name: self.builder.kept.get((self.own_path, name), value)
            for name, value in names.items()
        }
        self.builder.around.update({(self.own_path, name): value for name, value in found.items()})
        return replace(self.scope, **found) if found else self.scope

    # ------------------------------------------------------------------------------------------- what is inside

    def inside(self, **names: object) -> Behaviour:
        parent = self.own_path if self.layer.needed(self) else self.parent
        return self.builder.layer(self.node, self.index + 1, self.inner(names), self.path, parent)

    def child(self, index: int, **names: object) -> Behaviour:
        """Return the behaviour of one child, with further names in its scope."""
        child = self.node.children[index]
        return self.builder.node(
            child, self.inner(names), self.path, path=f"{self.path}/{child.label}"
        )

    def children(self, **names: object) -> list[Behaviour]:
        """Return the behaviours of all children, in their order."""
        return [self.child(index, **names) for index in range(len(self.node.children))]

    def part(self, slot: str, **names: object) -> Behaviour | None:
        part = self.node.parts.get(slot)
        if part is None:
            return None
        return self.builder.node(part, self.inner(names), self.own_path, path=f"{self.path}:{slot}")

    def stand_in(self) -> Skill | None:
        """Return the mock that replaces the node's skill."""
        mocks = self.builder.mocks
        skill = self.found.skill
        if mocks is None or skill is None:
            return None
        return mocks.replace(skill, self.node.key.text, self.node.label, self.path)

    def skill(self) -> Behaviour:
        cls = self.found.skill
        assert cls is not None
        behaviour = self.stand_in() or cls(self.node.label)
        keys = {
            name: self.scope.key(target)
            for name, target in self.found.outputs.items()
            if name in cls.outputs
        }
        builder = self.builder
        bind_skill(
            behaviour, cls.inputs, builder.context, self.path, self.inputs(), keys, builder.board
        )
        return behaviour

    def subtree(self) -> Behaviour:
        called = self.found.subtree
        scope = self.scope
        assert called is not None
        assert called.root is not None
        interface = self.builder.analysis.interfaces[id(called)]
        shared = called.file.parameters if called.file is scope.definition.file else {}
        names: dict[str, Getter] = {name: scope.names[name] for name in shared}
        wired = self.inputs()
        for name, port in interface.inputs.items():
            names[name] = wired.get(name) or constant(port.default_value)
        _, _, below_root = self.path.partition("/")
        prefix = f"/{below_root or self.path}/"
        keys = {port: scope.key(target) for port, target in self.found.outputs.items()}
        inside = replace(
            scope, definition=called, prefix=prefix, names=names, keys=keys, failure=None
        )
        path = f"{self.path}/{called.root.label}"
        return Subtree(
            self.node.label, self.builder.node(called.root, inside, self.path, path=path)
        )
