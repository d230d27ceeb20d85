"""The skills that are installed, found by entry point (group `pomona.skills`: name → Skill class)."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import EntryPoint, entry_points

from executive.ports import QUANTITIES, RATIO, Port, PortType, Quantity, type_name
from executive.skill import Skill

GROUP = "pomona.skills"
BUILTIN_TYPES: Mapping[str, PortType] = {"bool": bool, "int": int, "number": float, "text": str, **QUANTITIES}


@dataclass(frozen=True, slots=True)
class SkillListing:
    """One skill for readers and editors: `pomona skills` prints these."""

    name: str
    summary: str
    inputs: tuple[Mapping[str, object], ...]
    outputs: tuple[Mapping[str, object], ...]
    devices: tuple[str, ...]
    failures: tuple[str, ...]
    module: str


class Registry(Mapping[str, type[Skill]]):
    """Skills by name, and the names of all types that their ports carry."""

    def __init__(self, skills: Mapping[str, type[Skill]], problems: Mapping[str, str] | None = None) -> None:
        self._skills = dict(skills)
        self.problems: Mapping[str, str] = dict(problems or {})
        """Skills that are installed and cannot be used, with the reason."""
        self.types: dict[str, PortType] = dict(BUILTIN_TYPES)
        for skill in self._skills.values():
            for port in (*skill.inputs.values(), *skill.outputs.values()):
                self.types.setdefault(type_name(port.type), port.type)

    @classmethod
    def installed(cls) -> Registry:
        """Every skill that an installed package offers. A skill that cannot be imported is reported, not raised."""
        skills: dict[str, type[Skill]] = {}
        problems: dict[str, str] = {}
        for name, points in _by_name(entry_points(group=GROUP)).items():
            point, problem = chosen(name, points, replacements())
            if problem:
                problems[name] = problem
                continue
            try:
                skill = point.load()
            except Exception as error:  # a third party's module may raise anything
                problems[point.name] = f"{point.value} cannot be imported: {type(error).__name__}: {error}"
                continue
            if isinstance(skill, type) and issubclass(skill, Skill):
                skills[point.name] = skill
            else:
                problems[point.name] = f"{point.value} is not a Skill"
        return cls(skills, problems)

    def __getitem__(self, name: str) -> type[Skill]:
        return self._skills[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._skills)

    def __len__(self) -> int:
        return len(self._skills)

    def listing(self) -> tuple[SkillListing, ...]:
        """All skills, by name."""
        return tuple(_list_skill(name, self._skills[name]) for name in sorted(self._skills))


def replacements() -> Mapping[str, str]:
    """Which package gives a skill that several offer: `POMONA_SKILLS="Detect=my_package Plan=other"`."""
    words = os.environ.get("POMONA_SKILLS", "").replace(",", " ").split()
    return {name: package for name, _, package in (word.partition("=") for word in words)}


def chosen(name: str, points: Sequence[EntryPoint], said: Mapping[str, str]) -> tuple[EntryPoint, str]:
    """The entry point that gives a skill, and what is wrong when packages offer different ones under one name."""
    if len(points) == 1 and name not in said:
        return points[0], ""
    offers = {_package(point): point for point in points}
    if name in said:
        found = offers.get(said[name])
        return found or points[0], "" if found else f"'{said[name]}' offers no {name}: {', '.join(offers)} do"
    if len({point.value for point in points}) > 1:
        packages = " and ".join(sorted(offers))
        return points[0], f"{packages} both offer it: remove one, or choose: POMONA_SKILLS={name}={sorted(offers)[0]}"
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
    return SkillListing(
        name, summary, ports(skill.inputs), ports(skill.outputs), devices, skill.failures, skill.__module__
    )  # fmt: skip


def default_text(port: Port) -> str:
    """The default as it would be written in a tree file."""
    default = port.default
    if isinstance(default, Enum):
        return default.value if isinstance(default.value, str) else default.name
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(port.type, Quantity) and not isinstance(default, str):
        return port.type.format(default)
    return str(default)


def port_facts(name: str, port: Port) -> dict[str, object]:
    """A port as plain values, leaving out what it does not say."""
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
