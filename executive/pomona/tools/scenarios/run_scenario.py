"""Run a scenario's cases on a simulated clock, and report the nodes and ends that no case reached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, repeat

from py_trees.common import Status

from pomona.executive.clock import Clock
from pomona.executive.language.build import build
from pomona.executive.language.built import BuiltTree, NodeInfo
from pomona.executive.nodes.ask import Question
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.reasons import Reason, reason_of
from pomona.executive.registry import Registry
from pomona.executive.skill_testing import BenchContext
from pomona.executive.values.findings import TreeFileError
from pomona.tools.scenarios.scenario import Scenario, ScenarioCase

PERIOD = 0.02
MAX_TICKS = 200_000


@dataclass(frozen=True, slots=True)
class CaseResult:
    """How one case went; `problems` is empty when all went as expected."""

    case: ScenarioCase
    status: str
    reason: Reason | None
    time: float
    problems: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether everything went as expected."""
        return not self.problems


_ENDS: Mapping[str, frozenset[Status]] = {
    "success": frozenset({Status.SUCCESS}),
    "failure": frozenset({Status.FAILURE}),
    "skipped": frozenset({Status.INVALID}),
    "not skipped": frozenset({Status.SUCCESS, Status.FAILURE, Status.RUNNING}),
}


@dataclass(slots=True, eq=False)
class Coverage:
    """Which nodes were ticked, and how they ended."""

    types: Mapping[str, NodeType]
    nodes: dict[str, NodeInfo] = field(default_factory=dict)
    seen: dict[str, set[Status]] = field(default_factory=dict)

    def unreached(self) -> tuple[NodeInfo, ...]:
        """Return nodes that no case has ticked."""
        return tuple(info for path, info in self.nodes.items() if path not in self.seen)

    def ends_never_seen(self) -> tuple[tuple[NodeInfo, str], ...]:
        """Skills and conditions that ran and never ended in one of their ways."""
        found: list[tuple[NodeInfo, str]] = []
        for path, info in self.nodes.items():
            if path in self.seen:
                known = self.types[info.kind].ends if info.kind in self.types else ()
                ends = ("success", "failure") if info.failures else known
                found.extend((info, end) for end in ends if not _ENDS[end] & self.seen[path])
        return tuple(found)

    def share(self) -> float:
        """Return the share of the nodes that were reached."""
        return 1.0 if not self.nodes else len(self.seen) / len(self.nodes)


@dataclass(frozen=True, slots=True)
class ScenarioResult:
    """How a scenario went."""

    cases: tuple[CaseResult, ...]
    coverage: Coverage


def run_scenario(scenario: Scenario, skills: Registry) -> ScenarioResult:
    """Run every case. Raises TreeFileError: the scenario or its tree has errors."""
    errors = [finding for finding in scenario.findings if finding.severity == "error"]
    if errors or scenario.document is None:
        raise TreeFileError(errors)
    coverage = Coverage(scenario.document.types)
    results = []
    for case in scenario.cases:
        context = BenchContext()
        tree = build(
            scenario.document, skills, context=context, overrides=case.settings, mocks=case.mocks
        )
        results.append(_run_case(case, tree, context.clock, coverage))
    return ScenarioResult(tuple(results), coverage)


def _run_case(case: ScenarioCase, tree: BuiltTree, clock: Clock, coverage: Coverage) -> CaseResult:
    seen: dict[str, set[Status]] = {}
    starts: dict[str, int] = {}
    running: set[str] = set()
    ticks = 0
    asked = _attended(case, tree)
    coverage.nodes.update({info.path: info for info in tree.nodes})
    while clock.now() <= case.limit and ticks < MAX_TICKS:
        ticks += 1
        tree.board.tick = ticks
        now_running: set[str] = set()
        for node in tree.root.tick():
            path = str(getattr(node, "path", node.name))
            if path not in tree.behaviours:
                continue
            seen.setdefault(path, set()).add(node.status)
            if path not in running:
                starts[path] = starts.get(path, 0) + 1
            if node.status is Status.RUNNING:
                now_running.add(path)
        running = now_running
        if tree.root.status is not Status.RUNNING:
            break
        for question, answers in asked:
            if question.open:
                question.answer(question.starts, next(answers))
        clock.advance(PERIOD)
    status = tree.root.status
    reason = reason_of(tree.root) if status is Status.FAILURE else None
    if status is Status.RUNNING:
        tree.root.stop(Status.INVALID)
    for path, statuses in seen.items():
        coverage.seen.setdefault(path, set()).update(statuses)
    problems = tuple(_problems(case, status, reason, tree, starts))
    return CaseResult(case, status.name.lower(), reason, clock.now(), problems)


def _attended(case: ScenarioCase, tree: BuiltTree) -> list[tuple[Question, Iterator[str]]]:
    """Return the questions with an answer, with the answers in their order; nodes of one name share them."""
    found: list[tuple[Question, Iterator[str]]] = []
    for name, answers in case.answers.items():
        words = chain(answers, repeat(answers[-1]))
        for question in _asked_by(tree, name):
            question.attended = True
            found.append((question, words))
    return found


def _asked_by(tree: BuiltTree, name: str) -> Iterator[Question]:
    """Yield the questions to the operator of the nodes of a name and of their modifiers."""
    named = set(tree.find(name))
    kinds = {info.path: info.kind for info in tree.nodes}
    for path, question in tree.questions.items():
        if named.intersection((path, path.removesuffix(f":{kinds[path]}"))):
            yield question


def _problems(
    case: ScenarioCase,
    status: Status,
    reason: Reason | None,
    tree: BuiltTree,
    starts: Mapping[str, int],
) -> list[str]:
    found = []
    ended = status.name.lower()
    if ended != case.expect.status:
        if status is Status.RUNNING:
            ended = f"still running after {case.limit:g} s"
        why = f": {reason.code} {reason.message}" if reason is not None else ""
        found.append(f"expected {case.expect.status}, got {ended}{why}")
    if case.expect.code and reason is not None and case.expect.code not in reason.codes():
        found.append(
            f"expected the failure {case.expect.code}, got {reason.code}: {reason.message}"
        )
    if case.expect.node and reason is not None:
        leaves = dict.fromkeys(leaf.node_path for leaf in reason.leaves())
        if not leaves.keys() & tree.find(case.expect.node):
            found.append(f"expected {case.expect.node} to fail, it was {', '.join(leaves)}")
    for name in case.visits:
        if not starts.keys() & tree.find(name):
            found.append(f"'{name}' was never reached")
    for name in case.never:
        if starts.keys() & tree.find(name):
            found.append(f"'{name}' was reached")
    for name, wanted in case.calls.items():
        calls = sum(starts.get(path, 0) for path in tree.find(name))
        if calls != wanted:
            found.append(f"'{name}' started {calls} times, expected {wanted}")
    return found
