"""Mocks: skills that end as it is written in a file, to test a tree's logic without any cell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from typing import Any

from pomona.executive.ports import Port, Ports, Quantity, type_name
from pomona.executive.reasons import NoValue
from pomona.executive.skill import Skill, Work


class Placeholder:
    """Stands for a value that only the real skill could make; it has the fields that the mock was given."""

    is_placeholder = True

    def __init__(self, of: str, fields: Mapping[str, Any] | None = None) -> None:
        self._of, self._fields = of, dict(fields or {})

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._fields:
            raise NoValue(f"the mock gives a {self._of} without '{name}': add it to the mock's outputs")
        return self._fields[name]

    def __repr__(self) -> str:
        return f"<{self._of}>"


@dataclass(frozen=True, slots=True)
class MockResult:
    """How one call of a mock ends, after a duration on the run's clock."""

    status: str = "success"
    after: float = 0.0
    outputs: Mapping[str, Any] = field(default_factory=dict)
    code: str = ""
    message: str = ""


class MockSkill(Skill):
    """Replaces a skill, with its ports, and ends with the given result."""

    results: tuple[MockResult, ...] = (MockResult(),)
    replaced: type[Skill] = Skill
    calls: Iterator[int]

    def run(self, **inputs: Any) -> Work[Mapping[str, object]]:
        result = self.results[min(next(self.calls), len(self.results)) - 1]
        if result.after > 0.0:
            yield from self.wait(result.after)
        while result.status == "running":
            yield "runs until it is interrupted"
        if result.status == "failure":
            raise self.failure(result.code, result.message or f"the mock of {self.replaced.__name__} fails")
        return {name: result.outputs.get(name, placeholder(self.replaced.outputs[name])) for name in self.outputs}


def mock_class(
    skill: type[Skill], results: Iterable[MockResult] = (), calls: Iterator[int] | None = None
) -> type[MockSkill]:
    """Return a class of mocks for a skill; `calls` numbers its calls from 1, those of mocks that share results, too."""
    body = {
        "inputs": skill.inputs,
        "outputs": Ports(**{name: Port(object) for name in skill.outputs}),
        "failures": (*skill.failures, "MOCKED"),
        "results": tuple(results) or (MockResult(),),
        "replaced": skill,
        "calls": calls or count(1),
        "__doc__": skill.__doc__,
    }
    return type(f"Mock{skill.__name__}", (MockSkill,), body)


def placeholder(port: Port) -> Any:
    """Return an output that a mock has no value for: zero, an empty text, the first choice, or a placeholder."""
    port_type = port.type
    if isinstance(port_type, Quantity) or port_type is float:
        return 0.0
    if port_type in (bool, int):
        return port_type(0)
    if port_type is str:
        return port.choices[0] if port.choices else ""
    if issubclass(port_type, Enum):
        return next(iter(port_type))
    return Placeholder(type_name(port_type))


@dataclass(slots=True, eq=False)
class MockPlan:
    """The mocks of a run; a skill without a result succeeds at once."""

    # by node path, node name or skill name; the most specific one applies
    results: Mapping[str, tuple[MockResult, ...]] = field(default_factory=dict)
    keep: frozenset[str] = frozenset()  # names of skills that stay real
    # number of calls by the key of `results`: nodes that share results share the number
    calls: dict[str, Iterator[int]] = field(default_factory=dict)

    def replace(self, skill: type[Skill], skill_name: str, label: str, path: str) -> Skill | None:
        """See `pomona.executive.language.build.Mocks`."""
        if skill_name in self.keep:
            return None
        below_root = path.partition("/")[2]
        for name in (path, below_root, label, skill_name):
            if name in self.results:
                calls = self.calls.setdefault(name, count(1))
                return mock_class(skill, self.results[name], calls)(label)
        return mock_class(skill)(label)
