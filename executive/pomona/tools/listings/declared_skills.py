"""Declarations of the installed skills, without importing them.

A skill imports its libraries: networks, meshes, compiled loops. That takes seconds, which a command that only needs the
ports cannot spare. So a file in the user's cache keeps the declarations with the stamps of all imported sources. The
declarations are renewed when a source, the set of installed packages or the Python version changes.

The file yields stand-ins: classes with the names, fields and members that a check reads. Stand-ins cannot run. If a
check needs the class itself (`NotLoadedError`), the skills are imported.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import sysconfig
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, TypeVar

from pomona.executive.language.value_types import (
    DECLARED_FIELDS,
    ListType,
    Loose,
    NotLoadedError,
    fields_of,
)
from pomona.executive.ports import REQUIRED, Port, Ports, Quantity
from pomona.executive.registry import GROUP, Registry, replacements
from pomona.executive.skill import Skill
from pomona.executive.values.installation import entry_points
from pomona.executive.values.units import QUANTITIES

T = TypeVar("T")

VERSION = 5  # of the file's form

_PLAIN: Mapping[str, type[Any]] = {
    cls.__name__: cls
    for cls in (bool, int, float, str, object, list, tuple, dict, bytes, type(None))
}
_SIMPLE = (bool, int, float, str)


class _Unsayable(Exception):
    """A declaration that a file cannot carry."""


def declared_skills() -> Registry:
    """Return every installed skill's declaration, or the skills themselves without a valid cache."""
    points = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    path = _folder() / f"skills-{_digest(points)}.json"
    kept = _read(path)
    if kept is not None:
        with contextlib.suppress(
            Exception
        ):  # another process may have written the file: treat it as missing
            return _Reader(kept["classes"]).registry(kept["skills"])
    registry = Registry.installed()
    if not registry.problems:
        with contextlib.suppress(_Unsayable, OSError):
            _keep(path, registry, points)
    return registry


def with_declarations(action: Callable[[Registry], T]) -> T:
    """Do something that needs skills' declarations only, without importing the skills if that can be avoided."""
    try:
        return action(declared_skills())
    except NotLoadedError:
        return action(Registry.installed())


def _folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "pomona"


def _digest(points: Iterable[EntryPoint]) -> str:
    offered = [(point.name, point.value) for point in points]
    said = [
        VERSION,
        str(Path(__file__).parents[3]),
        sys.version,
        sys.prefix,
        offered,
        sorted(replacements().items()),
    ]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:16]


# ------------------------------------------------------------------------------------------- stamps


def _stamp(path: str) -> list[int]:
    found = os.stat(path)
    return [found.st_mtime_ns, found.st_size]


def _sources(points: Iterable[EntryPoint]) -> dict[str, list[int]]:
    """Stamp all imported sources, except those of Python itself and of packages without a skill.

    For the excepted packages the folders of installation are stamped: they change with every installation or removal.
    """
    kinds = ("site-packages", "dist-packages")
    places = {place for place in sys.path if place.endswith(kinds) and os.path.isdir(place)}
    own = {point.module.partition(".")[0] for point in points}
    python = sysconfig.get_path("stdlib")
    found = {place: _stamp(place) for place in places}
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if not isinstance(file, str) or not file.endswith(".py") or not os.path.isabs(file):
            continue
        installed = any(file.startswith(place + os.sep) for place in places)
        if name.partition(".")[0] in own or not (installed or file.startswith(python + os.sep)):
            found[file] = _stamp(file)
    return found


def _read(path: Path) -> dict[str, Any] | None:
    """Return the kept declarations if no source has changed since."""
    try:
        kept = json.loads(path.read_bytes())
        if all(_stamp(source) == stamp for source, stamp in kept["sources"].items()):
            return dict(kept)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        pass
    return None


def _keep(path: Path, registry: Registry, points: Iterable[EntryPoint]) -> None:
    writer = _Writer()
    skills = {name: writer.skill(skill) for name, skill in registry.items()}
    kept = {"sources": _sources(points), "classes": writer.classes, "skills": skills}
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(f".{os.getpid()}")
    fresh.write_text(json.dumps(kept))
    fresh.replace(path)


# ------------------------------------------------------------------------------------------- classes → file


class _Writer:
    def __init__(self) -> None:
        self.classes: list[dict[str, Any]] = []
        self.known: dict[type, int] = {}

    def skill(self, skill: type[Skill]) -> dict[str, Any]:
        return {
            "class": skill.__name__,
            "module": skill.__module__,
            "doc": skill.__doc__,
            "inputs": {name: self.port(port) for name, port in skill.inputs.items()},
            "outputs": {name: self.port(port) for name, port in skill.outputs.items()},
            "devices": [self.type_said(interface, shallow=True) for interface in skill.devices],
            "optional_devices": [
                self.type_said(interface, shallow=True) for interface in skill.optional_devices
            ],
            "moves": [skill.devices.index(interface) for interface in skill.claims()],
            "failures": list(skill.failures),
            "renamed_failures": dict(skill.renamed_failures),
        }

    def port(self, port: Port) -> dict[str, Any]:
        limits = [port.min, port.max]
        if not all(limit is None or isinstance(limit, _SIMPLE) for limit in limits):
            raise _Unsayable
        found = {
            "type": self.type_said(port.type),
            "help": port.help,
            "limits": limits,
            "choices": list(port.choices),
            "was": port.was,
        }
        if not port.required:
            found["default"] = self.value(port.default)
        return found

    def value(self, value: Any) -> Any:
        if isinstance(value, Enum):
            return {"enum": self.type_said(type(value)), "member": value.name}
        return value if value is None or isinstance(value, _SIMPLE) else {"text": str(value)}

    def type_said(self, found: Any, *, shallow: bool = False) -> Any:
        if isinstance(found, Quantity):
            return {"quantity": found.name, "units": dict(found.units)}
        if isinstance(found, Loose):
            return {"loose": found.name}
        if isinstance(found, ListType):
            return {
                "list": self.type_said(found.element),
                "length": found.length,
                "array": found.array,
            }
        if found.__module__ == "builtins" and found.__name__ in _PLAIN:
            return found.__name__
        top = found.__module__.partition(".")[0]
        if top == "builtins" or top in sys.stdlib_module_names:
            return {"module": found.__module__, "name": found.__qualname__}
        if found not in self.known:
            self.known[found] = len(self.classes)
            said: dict[str, Any] = {"name": found.__name__, "module": found.__module__}
            self.classes.append(said)
            self.describe(found, said, shallow)
        return {"class": self.known[found]}

    def describe(self, found: Any, said: dict[str, Any], shallow: bool) -> None:
        if issubclass(found, Enum):
            said["members"] = [(member.name, member.value) for member in found]
            if not all(isinstance(value, _SIMPLE) for _, value in said["members"]):
                raise _Unsayable
            return
        hidden = ("object", "Protocol", "Generic", "ABC", "NamedTuple")
        said["bases"] = [
            self.type_said(base, shallow=shallow)
            for base in found.__bases__
            if base.__name__ not in hidden
        ]
        fields = None if shallow else fields_of(found)
        said["fields"] = (
            None
            if fields is None
            else {name: self.type_said(field) for name, field in fields.items()}
        )


# ------------------------------------------------------------------------------------------- file → stand-ins


class _Reader:
    def __init__(self, classes: Sequence[Mapping[str, Any]]) -> None:
        self.said = classes
        self.made: dict[int, type[Any]] = {}
        for index in range(len(classes)):
            self.stand_in(index)
        for index, said in enumerate(classes):
            if said.get("fields") is not None:
                fields = tuple(
                    (name, self.type_said(field)) for name, field in said["fields"].items()
                )
                setattr(self.made[index], DECLARED_FIELDS, fields)

    def registry(self, skills: Mapping[str, Mapping[str, Any]]) -> Registry:
        return Registry({name: self.skill(said) for name, said in skills.items()})

    def skill(self, said: Mapping[str, Any]) -> type[Skill]:
        devices = tuple(self.type_said(device) for device in said["devices"])
        body = {
            "__module__": said["module"],
            "__doc__": said["doc"],
            "inputs": Ports(**{name: self.port(port) for name, port in said["inputs"].items()}),
            "outputs": Ports(**{name: self.port(port) for name, port in said["outputs"].items()}),
            "devices": devices,
            "optional_devices": tuple(
                self.type_said(device) for device in said["optional_devices"]
            ),
            "moves": tuple(devices[index] for index in said["moves"]),
            "failures": tuple(said["failures"]),
            "renamed_failures": dict(said["renamed_failures"]),
        }
        return type(said["class"], (Skill,), body)

    def port(self, said: Mapping[str, Any]) -> Port:
        default = self.value(said["default"]) if "default" in said else REQUIRED
        low, high = said["limits"]
        return Port(
            self.type_said(said["type"]),
            default,
            said["help"],
            low,
            high,
            tuple(said["choices"]),
            said["was"],
        )

    def value(self, said: Any) -> Any:
        if not isinstance(said, dict):
            return said
        return (
            self.type_said(said["enum"])[said["member"]] if "enum" in said else _Shown(said["text"])
        )

    def type_said(self, said: Any) -> Any:
        if isinstance(said, str):
            return _PLAIN[said]
        if "quantity" in said:
            known = QUANTITIES.get(said["quantity"])
            return (
                known
                if known and known.units == said["units"]
                else Quantity(said["quantity"], said["units"])
            )
        if "loose" in said:
            return Loose[said["loose"]]
        if "list" in said:
            return ListType(self.type_said(said["list"]), said["length"], said["array"])
        if "class" in said:
            return self.stand_in(said["class"])
        found: Any = import_module(said["module"])
        for name in said["name"].split("."):
            found = getattr(found, name)
        return found

    def stand_in(self, index: int) -> type[Any]:
        if index not in self.made:
            said = self.said[index]
            if "members" in said:
                members = [(name, value) for name, value in said["members"]]
                self.made[index] = Enum(said["name"], members, module=said["module"])  # type: ignore[assignment]
            else:
                bases = tuple(self.type_said(base) for base in said["bases"]) or (object,)
                body = {"__module__": said["module"], DECLARED_FIELDS: None}
                self.made[index] = types.new_class(
                    said["name"], bases, exec_body=lambda space: space.update(body)
                )
        return self.made[index]


class _Shown:
    """A default that can only be shown."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text
