"""The skills that are installed, found by entry point (group `pomona.skills`: name → Skill class)."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from importlib.metadata import EntryPoint
from itertools import chain

from pomona.executive.ports import QUANTITIES, RATIO, Port, Ports, PortType, Quantity, type_name
from pomona.executive.skill import Skill
from pomona.executive.values.installation import entry_points
from pomona.executive.values.removed import import_problem

GROUP = "pomona.skills"
Loader = Callable[[], type[Skill] | str]
"""Loads a skill, or returns why it cannot be used."""
CHOSEN = "POMONA_SKILLS"  # of the environment, for the run's other processes: `Detect=my_package Plan=other`


@dataclass(frozen=True, slots=True)
class SkillListing:
    """One skill for readers and editors: `pomona skills` prints these."""

    name: str
    summary: str
    inputs: tuple[Mapping[str, object], ...]
    outputs: tuple[Mapping[str, object], ...]
    devices: tuple[str, ...]
    optional_devices: tuple[str, ...]
    failures: tuple[str, ...]
    module: str


_TYPES: Mapping[str, PortType] = {
    "bool": bool,
    "int": int,
    "number": float,
    "text": str,
    **QUANTITIES,
}


class Registry(Mapping[str, type[Skill]]):
    """Skills by name, and the names of all types that their ports carry."""

    def __init__(self, skills: Mapping[str, type[Skill] | Loader]) -> None:
        """`skills` are classes, or are loaded when they are looked up: most trees use few of them."""
        self._skills = dict(skills)
        self._problems: dict[str, str] = {}

    @property
    def problems(self) -> Mapping[str, str]:
        """Skills that are installed and cannot be used, with the reason."""
        len(self)  # loads all
        return self._problems

    @property
    def renamed_failures(self) -> Mapping[str, str]:
        """Failure codes of the previous version, each with its present name."""
        return {old: new for skill in self.values() for old, new in skill.renamed_failures.items()}

    @property
    def types(self) -> Mapping[str, PortType]:
        """Types of ports by name."""
        return dict(reversed(list(self._types())))

    def type_named(self, name: str) -> PortType | None:
        """Return a type by its name, of a skill that was looked up rather than of another one."""
        loaded = Registry({k: v for k, v in self._skills.items() if isinstance(v, type)})
        types = chain(loaded._types(), self._types())
        return next((found for known, found in types if known == name), None)

    def _types(self) -> Iterator[tuple[str, PortType]]:
        yield from _TYPES.items()
        for skill in self.values():
            for port in (*skill.inputs.values(), *skill.outputs.values()):
                yield type_name(port.type), port.type

    @classmethod
    def installed(cls) -> Registry:
        """Return every skill of the installed packages. A skill that cannot be imported is reported, not raised."""
        return cls({}).choosing({}, tuple(_by_name(entry_points(group=GROUP))))

    def choosing(self, said: Mapping[str, str], names: Iterable[str] | None = None) -> Registry:
        """Return this registry with the skills of the packages that a tree names: package by skill. Choices of the
        command line have priority.

        An unusable choice is reported, not raised.

        Args:
            names: skills to look up; by default those that the tree names.
        """
        looked_up = tuple(said if names is None else names)
        if not looked_up:
            return self
        offered = _by_name(entry_points(group=GROUP))
        chosen = {**said, **replacements()}
        loaders = {
            name: partial(_loaded, name, offered.get(name, []), chosen) for name in looked_up
        }
        return Registry({**self._skills, **loaders})

    def declaring(self, ports: Mapping[str, tuple[Sequence[str], Sequence[str]]]) -> Registry:
        """This registry with stand-ins for skills that are not installed: by name their inputs and outputs.

        A stand-in takes and gives anything, and cannot be run.
        """
        missing = {name: _stand_in(name, *both) for name, both in ports.items() if name not in self}
        return Registry({**self._skills, **missing}) if missing else self

    def __getitem__(self, name: str) -> type[Skill]:
        found = self._skills[name]
        if not isinstance(found, type):
            loaded = found()
            if isinstance(loaded, str):
                self._problems[name] = loaded
                raise KeyError(name)
            self._skills[name] = found = loaded
        return found

    def __iter__(self) -> Iterator[str]:
        return (name for name in list(self._skills) if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def giving(self, wanted: PortType, there: Collection[object]) -> list[tuple[str, str]]:
        """Skill and port of every output of a type, least lacking inputs first; a skill that lacks this one is none."""
        needed = {
            name: [it.type for it in skill.inputs.values() if it.required]
            for name, skill in self.items()
        }
        lacking = {name: [it for it in types if it not in there] for name, types in needed.items()}
        writers = [name for name in self if wanted not in lacking[name]]
        writers.sort(key=lambda name: len(lacking[name]))
        return [
            (name, port)
            for name in writers
            for port, it in self[name].outputs.items()
            if it.type == wanted
        ]

    def listing(self) -> tuple[SkillListing, ...]:
        """Return all skills, by name."""
        return tuple(_list_skill(name, self[name]) for name in sorted(self))


def source_of(name: str) -> str:
    """Return where an installed skill's class stands: `pomona/skills/lift.py:57`; of a third party `module:line`.

    Empty for a skill that is not installed, cannot be imported, or has no source.
    """
    skill = Registry({}).choosing({}, (name,)).get(name)
    if skill is None:
        return ""
    try:
        line = inspect.getsourcelines(skill)[1]
        file = inspect.getfile(skill)
    except (OSError, TypeError):  # its source is not installed, or it was not read from a file
        return ""
    if not skill.__module__.startswith("pomona."):
        return f"{skill.__module__}:{line}"
    inside = "/__init__.py" if os.path.basename(file) == "__init__.py" else ".py"
    return f"{skill.__module__.replace('.', '/')}{inside}:{line}"


def _stand_in(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> type[Skill]:
    body = {
        "__doc__": "Declared in the tree, and not installed.",
        "inputs": Ports(**{port: Port(object, default=None) for port in inputs}),
        "outputs": Ports(**{port: Port(object) for port in outputs}),
        "failures": ("FAILED",),
    }
    return type(name, (Skill,), body)


def _loaded(name: str, points: Sequence[EntryPoint], said: Mapping[str, str]) -> type[Skill] | str:
    """Return a skill, or why it cannot be used."""
    if not points:
        return "no package offers it"
    point, problem = chosen(name, points, said)
    if problem:
        return problem
    try:
        skill = point.load()
    except Exception as error:  # a third party's module may raise anything
        return f"{point.value} cannot be imported: {import_problem(error)}"
    return (
        skill
        if isinstance(skill, type) and issubclass(skill, Skill)
        else f"{point.value} is not a Skill"
    )


def replacements() -> Mapping[str, str]:
    """Which package gives a skill that several offer: `pomona --skill Detect=my_package`, or `POMONA_SKILLS`."""
    words = os.environ.get(CHOSEN, "").replace(",", " ").split()
    return {name: package for name, _, package in (word.partition("=") for word in words)}


def chosen(
    name: str, points: Sequence[EntryPoint], said: Mapping[str, str]
) -> tuple[EntryPoint, str]:
    """Return the entry point of a skill, and the problem if packages offer different ones under one name."""
    if len(points) == 1 and name not in said:
        return points[0], ""
    offers = {_package(point): point for point in points}
    if name in said:
        found = offers.get(said[name])
        return found or points[
            0
        ], "" if found else f"'{said[name]}' offers no {name}: {', '.join(offers)} do"
    if len({point.value for point in points}) > 1:
        packages = " and ".join(sorted(offers))
        one = sorted(offers)[0]
        choose = f"skills: {{{name}: {one}}} in the tree, or pomona --skill {name}={one}"
        return points[0], f"{packages} both offer it: remove one, or choose: {choose}"
    return points[0], ""


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.module.partition(".")[0]


def _by_name(points: Iterable[EntryPoint]) -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for point in points:
        found.setdefault(point.name, []).append(point)
    return found


def _list_skill(name: str, skill: type[Skill]) -> SkillListing:
    def ports(declared: Mapping[str, Port]) -> tuple[Mapping[str, object], ...]:
        return tuple(port_facts(port_name, port) for port_name, port in declared.items())

    summary = (skill.__doc__ or "").strip().split("\n")[0]
    devices = tuple(interface.__name__ for interface in skill.devices)
    optional = tuple(
        interface.__name__ for interface in skill.optional_devices if interface not in skill.devices
    )
    inputs = ports(skill.inputs)
    outputs = ports(skill.outputs)
    return SkillListing(
        name, summary, inputs, outputs, devices, optional, skill.failures, skill.__module__
    )


def default_text(port: Port) -> str:
    """Return the default as it would be written in a tree file."""
    default = port.default
    if isinstance(default, Enum):
        return default.value if isinstance(default.value, str) else default.name
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(port.type, Quantity) and not isinstance(default, str):
        return port.type.format(default)
    return str(default)


def port_facts(name: str, port: Port) -> dict[str, object]:
    """Return a port as plain values, without absent ones."""
    facts: dict[str, object] = {"name": name, "type": type_name(port.type)}
    if isinstance(port.type, Quantity):
        facts["units"] = list(port.type.units)
    facts["required"] = port.required
    if not port.required and port.default is not None:
        plain = isinstance(port.default, (bool, int, float)) and not (
            isinstance(port.type, Quantity) and port.type != RATIO
        )
        facts["default"] = port.default if plain else default_text(port)
    if port.min is not None:
        facts["min"] = port.min
    if port.max is not None:
        facts["max"] = port.max
    if port.choices:
        facts["choices"] = list(port.choices)
    if port.help:
        facts["help"] = port.help
    return facts
