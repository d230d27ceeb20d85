"""The numbers of a simulated fruit wall: one file, with unit, source and standing of each."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from pomona.drivers import read_section_file
from pomona.executive import (
    ANGLE,
    FORCE,
    LENGTH,
    MASS,
    PRESSURE,
    RATE,
    SPEED,
    STIFFNESS,
    TORQUE,
    AsWritten,
    MappingOf,
    Measure,
    Number,
    Quantity,
    Section,
    Span,
    Text,
    ValueFile,
    YamlMapping,
    YamlNode,
    YamlScalar,
    value,
)

MODULUS = Quantity("modulus", {**PRESSURE.units, "GPa": 1e9})
DENSITY = Quantity("density", {"kg/m³": 1.0, "kg/m^3": 1.0})
AREA_DENSITY = Quantity("area_density", {"kg/m²": 1.0, "kg/m^2": 1.0})
INERTIA = Quantity("inertia", {"kg·m²": 1.0})
PER_LENGTH = Quantity("per_length", {"1/m": 1.0})
STANDINGS = ("measured", "derived", "assumed")

_share = Number(0.0, 10.0)
Range = tuple[float, float]


def _lengths() -> Span:
    return Span(Measure(LENGTH, "0.1 mm", "2 m"))


@dataclass(frozen=True, slots=True, kw_only=True)
class WallNumbers:
    """Properties of wood, stems, fruit, leaves and wind, in SI units; the file documents each."""

    wood_modulus: float = value(Measure(MODULUS))
    wood_density: float = value(Measure(DENSITY))
    wood_rupture: float = value(Measure(MODULUS))
    wood_damping: float = value(_share)
    wood_friction: float = value(_share)
    hinge_armature: float = value(Measure(INERTIA))
    trunk_diameter: Range = value(_lengths())
    lateral_length: Range = value(_lengths())
    lateral_base: Range = value(_lengths())
    lateral_tip: Range = value(_lengths())
    laterals: Range = value(Span(Number(2.0, 12.0)))
    spur_length: Range = value(_lengths())
    spur_diameter: Range = value(_lengths())
    wire_spacing: float = value(Measure(LENGTH))
    wire_diameter: float = value(Measure(LENGTH))
    wire_stiffness: float = value(Measure(STIFFNESS))
    wire_mass: float = value(Measure(MASS))
    fruit_density: float = value(Measure(DENSITY))
    fruit_diameter: Range = value(_lengths())
    fruit_height: Range = value(Span(_share))
    fruit_count: Range = value(Span(Number(1.0, 60.0)))
    cluster_two: float = value(Number(0.0, 1.0))
    cluster_three: float = value(Number(0.0, 1.0))
    fruit_friction: float = value(_share)
    stem_length: Range = value(_lengths())
    stem_diameter: float = value(Measure(LENGTH))
    stem_lean: Range = value(Span(Measure(ANGLE)))
    stem_stretch: float = value(Measure(STIFFNESS))
    stem_stretch_damping: float = value(_share)
    stem_swing_damping: float = value(_share)
    pull_median: float = value(Measure(FORCE))
    pull_sigma: float = value(_share)
    twist_median: float = value(Measure(TORQUE))
    twist_sigma: float = value(_share)
    strength_shared: float = value(Number(0.0, 1.0))
    twist_angle: Range = value(Span(Measure(ANGLE)))
    bend_angle: Range = value(Span(Measure(ANGLE)))
    tear_median: float = value(Measure(FORCE))
    tear_sigma: float = value(_share)
    leaf_length: Range = value(_lengths())
    leaf_width: float = value(_share)
    leaf_mass: float = value(Measure(AREA_DENSITY))
    petiole_radius: float = value(Measure(LENGTH))
    petiole_length: Range = value(_lengths())
    leaf_damping: float = value(_share)
    leaves_per_spur: float = value(Number(0.0, 20.0))
    leaves_per_metre: float = value(Measure(PER_LENGTH))
    wind_strength: float = value(_share)
    wind_slowest: float = value(Measure(RATE))
    wind_fastest: float = value(Measure(RATE))
    wind_speed: float = value(Measure(SPEED))
    bruise_pressure: float = value(Measure(MODULUS))
    bruise_impact: float = value(Measure(FORCE))
    modulus_pad: float = value(Measure(MODULUS))
    modulus_lining: float = value(Measure(MODULUS))
    modulus_hard: float = value(Measure(MODULUS))

    def scaled(self, name: str, factor: float) -> WallNumbers:
        """Return the same numbers but one, or both ends of a range, times `factor`: for sensitivities."""
        number = getattr(self, name)
        changed: Any = (
            tuple(factor * n for n in number) if isinstance(number, tuple) else factor * number
        )
        return replace(self, **{name: changed})

    def digest(self) -> str:
        """Return an identifier of the numbers: the first 16 hexadecimal digits of a SHA-256 over all values."""
        text = ";".join(f"{field.name}={getattr(self, field.name)!r}" for field in fields(self))
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """One number as its file gives it."""

    source: str = value(Text(), help="where it was read, or why it was assumed")
    standing: str = value(Text(*STANDINGS), help="measured, derived or assumed")
    value: YamlScalar = value(AsWritten(), help="with its unit")


def read_numbers(path: Path) -> tuple[WallNumbers, Mapping[str, Provenance]]:
    """Return the numbers of a file, and where each comes from.

    Raises CellFileError: something is missing or wrong; all of it is in the error.
    """

    def read(file: ValueFile) -> tuple[WallNumbers, Mapping[str, Provenance]]:
        origins = MappingOf(Section(Provenance)).read(file.root, file.reader)
        return Section(WallNumbers).read(_values(file.root), file.reader), origins

    return read_section_file(path, "a wall's numbers", read)


def _values(root: YamlMapping) -> YamlMapping:
    """Return the mapping with each entry's value in its place."""
    return replace(
        root, entries={name: (key, _value(node)) for name, (key, node) in root.entries.items()}
    )


def _value(node: YamlNode) -> YamlNode:
    found = node.get("value") if isinstance(node, YamlMapping) else None
    assert found is not None, "judged as a Provenance before"
    return found
