"""Document → py_trees tree. Builds only what the check has passed."""

from __future__ import annotations

from collections import abc
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from executive.board import Board
from executive.language.bind_ports import bind_skill
from executive.language.build_scope import InstanceScope, condition, constant, getter
from executive.language.built import BuiltTree, NodeInfo
from executive.language.check import Analysis, analyse
from executive.language.expression_run import Getter
from executive.language.model import Definition, Document, TreeNode
from executive.language.names_of_nodes import UniquePaths
from executive.language.scope import Given, Resolved
from executive.nodes import (
    Check,
    Fail,
    Fallback,
    Force,
    ForEach,
    Guard,
    Invert,
    Parallel,
    Repeat,
    Retry,
    Sequence,
    SetValues,
    Subtree,
    Succeed,
    Timeout,
    Wait,
    WaitUntil,
    When,
)
from executive.nodes.in_sight import FailureInSight, ForEachCount, RepeatCount, RetryCount
from executive.registry import Registry
from executive.skill import Skill, SkillContext
from executive.values.findings import Finding, TreeFileError
from executive.values.written import written


class Mocks(Protocol):
    """Says which skills are replaced by mocks."""

    def replace(self, skill: type[Skill], skill_name: str, label: str, path: str) -> Skill | None:
        """The mock that stands in for a node's skill, or None to keep the skill."""
        ...


def build(
    document: Document,
    skills: Registry,
    *,
    context: SkillContext,
    board: Board | None = None,
    overrides: Mapping[str, str] | abc.Sequence[str] = (),
    interfaces: tuple[type, ...] | None = None,
    mocks: Mocks | None = None,
) -> BuiltTree:
    """Build a tree.

    Args:
        document: from `read`.
        skills: the skills that it may use.
        context: the run that its skills are bound to.
        board: a fresh one is made when it is left out.
        overrides: values for parameters, as a mapping or as texts `name=value`.
        interfaces: the cell's device interfaces; None skips the check of devices.
        mocks: replaces skills, for dry runs.

    Raises:
        TreeFileError: the document has errors; all of them are in it.
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
    names: dict[str, Getter] = {name: constant(value) for name, value in analysis.parameters.items()}
    scope = InstanceScope(analysis, main, board, "/", names)
    root = builder.node(main.root, scope, None, "", root_path=document.main.name)
    return BuiltTree(
        document.main.name,
        root,
        tuple(builder.nodes.values()),
        dict(builder.behaviours),
        dict(analysis.parameters),
        board,
    )


def _inputs_nobody_gives(main: Definition) -> list[Finding]:
    missing = [declared for declared in main.inputs.values() if declared.default is None]
    message = "is an input that only a calling tree can give: run a tree that calls this one"
    return [
        Finding(d.key.source.path, d.key.line, d.key.column, "error", "no-value", f"'{d.key.text}' {message}")
        for d in missing
    ]


class _Builder:
    def __init__(self, analysis: Analysis, context: SkillContext, board: Board, mocks: Mocks | None) -> None:
        self.analysis, self.context, self.board, self.mocks = analysis, context, board, mocks
        self.now = context.elapsed
        self.nodes: dict[str, NodeInfo] = {}
        self.behaviours: dict[str, Behaviour] = {}
        self.paths = UniquePaths()

    def note(self, info: NodeInfo) -> None:
        """Reserve the node's place in drawing order; its behaviour follows."""
        self.nodes[info.path] = info
        self.behaviours[info.path] = py_trees.behaviours.Dummy(info.name)

    def made(self, path: str, behaviour: Behaviour) -> Behaviour:
        behaviour.path = path  # type: ignore[attr-defined]
        self.behaviours[path] = behaviour
        return behaviour

    # ------------------------------------------------------------------------------------------- one node

    def node(
        self,
        node: TreeNode,
        scope: InstanceScope,
        parent_path: str | None,
        parent_kind: str,
        *,
        root_path: str = "",
        parent: str | None = None,
        fixed_path: str = "",
    ) -> Behaviour:
        """Build a node with its modifiers, from the outside to the inside; then everything in reverse.

        Args:
            parent_path: path under which its own name is put.
            parent: path of the node that it is a child of; by default the same.
        """
        found = self.analysis.resolved[id(node)]
        path = self.paths.take(fixed_path or root_path or f"{parent_path}/{node.label}")
        above = parent if parent is not None else parent_path
        inner = scope
        wrappers: list[Callable[[Behaviour], Behaviour]] = []
        for name in reversed(node.decorators):
            if name == "invert" and not found.setting("invert", True):
                continue
            wrapped_path = f"{path}:{name}"
            text = {n: _written(node, n) for n in (name, *_TOGETHER.get(name, ())) if n in node.modifiers}
            self.note(self.info(node, wrapped_path, above, name, name, settings=text))
            inner, wrap = self.wrapper(node, found, name, wrapped_path, inner, parent_kind)
            wrappers.append(wrap)
            above = wrapped_path
        behaviour = self.bare(node, found, path, above, inner)
        for wrap in reversed(wrappers):
            behaviour = wrap(behaviour)
        return behaviour

    def info(self, node: TreeNode, path: str, parent: str | None, kind: str, type_: str, **more: Any) -> NodeInfo:
        own = kind == node.kind
        source = node.at.source
        name = node.label if own else kind
        if own and parent is None and node.name is None:
            name = path
        return NodeInfo(
            path, parent, kind, name, type_,
            node.description if own else "", node.comment if own else "",
            source.path, node.at.line, node.at.end_line, **more,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------- modifiers

    def wrapper(
        self, node: TreeNode, found: Resolved, name: str, path: str, scope: InstanceScope, parent_kind: str
    ) -> tuple[InstanceScope, Callable[[Behaviour], Behaviour]]:
        """The scope inside a modifier, and what puts the modifier's node around the one inside."""
        label = f"{name} {node.label}" if name != "retry" else node.label
        settings = found.settings
        match name:
            case "timeout":
                duration = getter(settings["timeout"], scope)
                return scope, lambda child: self.made(path, Timeout(label, child, duration, self.now))
            case "invert":
                return scope, lambda child: self.made(path, Invert(label, child))
            case "force":
                return scope, lambda child: self.made(path, Force(label, child, found.setting("force", "success")))
            case "guard":
                guard = condition(settings["guard"], scope)
                return scope, lambda child: self.made(path, Guard(label, child, guard))
            case "when":
                when = condition(settings["when"], scope)
                skipped = Status.FAILURE if parent_kind in ("fallback", "reactive_fallback") else Status.SUCCESS
                return scope, lambda child: self.made(path, When(label, child, when, skipped))
            case "repeat":
                rounds = getter(settings["repeat"], scope)
                repeat_count = RepeatCount()
                inside = replace(scope, repeat=repeat_count)
                return inside, lambda child: self.made(path, Repeat(label, child, rounds, repeat_count))
            case "for_each":
                return self.for_each(found, path, label, scope)
            case "retry":
                return self.retry(node, found, path, label, scope)
            case _:
                raise AssertionError(f"no such modifier: {name}")

    def for_each(
        self, found: Resolved, path: str, label: str, scope: InstanceScope
    ) -> tuple[InstanceScope, Callable[[Behaviour], Behaviour]]:
        items = getter(found.settings["for_each"], scope)
        count = ForEachCount()
        key, write = scope.key(found.outputs["for_each"]), self.board.write

        def give(item: Any) -> None:
            write(key, item, path)

        return replace(scope, for_each=count), lambda child: self.made(path, ForEach(label, child, items, give, count))

    def retry(
        self, node: TreeNode, found: Resolved, path: str, label: str, scope: InstanceScope
    ) -> tuple[InstanceScope, Callable[[Behaviour], Behaviour]]:
        total = getter(found.settings["retry"], scope)
        count, sight = RetryCount(), FailureInSight()
        inside = replace(scope, retry=count)
        after = replace(inside, failure=sight)
        retry_if = None
        if "retry_if" in found.settings:
            retry_if = condition(found.settings["retry_if"], after).holds
        own_path = path.removesuffix(":retry")

        def wrap(child: Behaviour) -> Behaviour:
            on_failure = None
            if node.on_failure is not None:
                on_failure = self.node(
                    node.on_failure, after, own_path, "retry", parent=path, fixed_path=f"{own_path}:on_failure"
                )
            return self.made(
                path,
                Retry(
                    label, child, self.now, total,
                    count=count, on_failure=on_failure, retry_if=retry_if, in_sight=sight,
                ),
            )  # fmt: skip

        return inside, wrap

    # ------------------------------------------------------------------------------------------- types

    def bare(self, node: TreeNode, found: Resolved, path: str, parent: str | None, scope: InstanceScope) -> Behaviour:
        kind = node.kind
        if kind == "skill":
            return self.skill(node, found, path, parent, scope)
        wiring: dict[str, Any] = {}
        if kind in ("subtree", "set", "fail"):
            wiring["inputs"] = {name: written(node.ports[name][1]) for name in found.inputs}
            wiring["outputs"] = {
                n: written(node.ports[n][1]) for n in found.outputs if n in node.ports and kind != "set"
            }
        else:
            wiring["settings"] = {n: _written(node, n) for n in ("success_on", "attempts") if n in node.modifiers}
            if kind in ("check", "wait", "wait_until"):
                wiring["settings"] = {kind: written(node.value)}
        type_ = node.key.text if kind == "subtree" else kind
        self.note(self.info(node, path, parent, kind, type_, **wiring))
        name = self.nodes[path].name
        if kind == "subtree":
            return self.subtree(node, found, path, scope)
        if kind in ("check", "wait_until"):
            looked_at = condition(found.settings[kind], scope)
            return self.made(path, Check(name, looked_at) if kind == "check" else WaitUntil(name, looked_at))
        if kind == "wait":
            return self.made(path, Wait(name, getter(found.settings["wait"], scope), self.now))
        if kind == "set":
            values = {scope.key(target): getter(value, scope) for target, value in found.inputs.items()}
            return self.made(path, SetValues(name, values, lambda key, value: self.board.write(key, value, path)))
        if kind == "fail":
            code = getter(found.inputs.get("code", Given("FAILED", node.key)), scope)
            message = getter(found.inputs.get("message", Given("", node.key)), scope)
            return self.made(path, Fail(name, code, message))
        if kind == "succeed":
            return self.made(path, Succeed(name))
        return self.branch(node, found, path, name, scope)

    def branch(self, node: TreeNode, found: Resolved, path: str, name: str, scope: InstanceScope) -> Behaviour:
        kind = node.kind
        if kind == "recovery":
            return self.recovery(node, found, path, name, scope)
        sight = scope.failure
        inside = scope
        if kind in ("fallback", "reactive_fallback"):
            sight = FailureInSight()
            inside = replace(scope, failure=sight)
        children = [
            self.node(child, scope if index == 0 else inside, path, kind) for index, child in enumerate(node.children)
        ]
        if kind in ("fallback", "reactive_fallback"):
            return self.made(path, Fallback(name, kind == "fallback", children, sight))
        if kind == "parallel":
            return self.made(path, Parallel(name, self.policy(node, found, children), children))
        return self.made(path, Sequence(name, kind == "sequence", children))

    @staticmethod
    def policy(node: TreeNode, found: Resolved, children: list[Behaviour]) -> ParallelPolicy.Base:
        success_on = found.setting("success_on", "all")
        if success_on == "all":
            return ParallelPolicy.SuccessOnAll()
        if success_on == "one":
            return ParallelPolicy.SuccessOnOne()
        chosen = [b for child, b in zip(node.children, children, strict=True) if child.label in success_on]
        return ParallelPolicy.SuccessOnSelected(chosen)

    def recovery(self, node: TreeNode, found: Resolved, path: str, name: str, scope: InstanceScope) -> Behaviour:
        attempts = found.settings.get("attempts")
        total = getter(attempts, scope) if attempts is not None else constant(2)
        count, sight = RetryCount(), FailureInSight()
        inside = replace(scope, retry=count)
        child = self.node(node.children[0], inside, path, "recovery")
        recover = self.node(node.children[1], replace(inside, failure=sight), path, "recovery")
        retry = Retry(name, child, self.now, total, count=count, on_failure=recover, between_only=True, in_sight=sight)
        return self.made(path, retry)

    def subtree(self, node: TreeNode, found: Resolved, path: str, scope: InstanceScope) -> Behaviour:
        called = found.subtree
        assert called is not None
        assert called.root is not None
        interface = self.analysis.interfaces[id(called)]
        shared = called.file.parameters if called.file is scope.definition.file else {}
        names: dict[str, Getter] = {name: scope.names[name] for name in shared}
        for name, port in interface.inputs.items():
            value = found.inputs.get(name)
            names[name] = getter(value, scope) if value is not None else constant(port.default_value)
        _, _, below_root = path.partition("/")
        prefix = f"/{below_root or path}/"
        keys = {port: scope.key(target) for port, target in found.outputs.items()}
        inside = replace(scope, definition=called, prefix=prefix, names=names, keys=keys, failure=None)
        child = self.node(called.root, inside, path, "subtree")
        return self.made(path, Subtree(node.label, child))

    def skill(self, node: TreeNode, found: Resolved, path: str, parent: str | None, scope: InstanceScope) -> Behaviour:
        cls = found.skill
        assert cls is not None
        mock = self.mocks.replace(cls, node.key.text, node.label, path) if self.mocks is not None else None
        behaviour = mock if mock is not None else cls(node.label)
        wired = {name: written(node.ports[name][1]) for name in found.inputs}
        self.note(
            self.info(
                node, path, parent, "skill", node.key.text,
                inputs=wired,
                outputs={name: written(node.ports[name][1]) for name in found.outputs if name in node.ports},
                devices=tuple(interface.__name__ for interface in cls.devices),
                failures=cls.failures,
                mocked=mock is not None,
            )
        )  # fmt: skip
        getters = {name: getter(value, scope) for name, value in found.inputs.items()}
        keys = {name: scope.key(target) for name, target in found.outputs.items() if name in cls.outputs}
        bind_skill(behaviour, cls.inputs, self.context, path, getters, keys, self.board)
        return self.made(path, behaviour)


_TOGETHER = {"retry": ("retry_if",), "for_each": ("as",)}


def _written(node: TreeNode, name: str) -> str:
    return written(node.modifiers[name][1])
