"""A bill of materials of Pomona and every package that it needs here, as CycloneDX 1.6 JSON, from installed metadata.

    python scripts/sbom.py sbom.cdx.json [--extra dev]

It lists the installed packages with version, licence and requirements. It does not prove that these files equal the
published ones (requirements.lock does, installed with --require-hashes), knows no system libraries, no code that a
package carries within itself, and no vulnerabilities.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import uuid
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

_REQUIREMENT = re.compile(r"^\s*([A-Za-z0-9][A-Za-z0-9._-]*)\s*(?:\[([^\]]*)\])?")
_EXTRA = re.compile(r"""extra\s*==\s*['"]([^'"]+)['"]""")


def normal(name: str) -> str:
    """A package's name as indexes write it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(name: str, extras: Iterable[str] = ()) -> dict[str, tuple[Distribution, set[str]]]:
    """Every installed package that a package needs, itself first: its distribution, and the names that it needs."""
    found: dict[str, tuple[Distribution, set[str]]] = {}
    waiting = [(name, frozenset(extras))]
    seen = set()
    while waiting:
        package, wanted = waiting.pop()
        if (normal(package), wanted) in seen:
            continue
        seen.add((normal(package), wanted))
        try:
            found_here = distribution(package)
        except PackageNotFoundError:  # of another platform, or left out on purpose
            continue
        entry = found.setdefault(normal(package), (found_here, set()))
        for text in found_here.requires or ():
            requirement = _REQUIREMENT.match(text)
            asked = set(_EXTRA.findall(text))
            if requirement is None or (asked and not asked & wanted):
                continue
            entry[1].add(normal(requirement[1]))
            waiting.append(
                (
                    requirement[1],
                    frozenset(e.strip() for e in (requirement[2] or "").split(",") if e.strip()),
                )
            )
    return found


def bill(name: str, extras: Iterable[str] = ()) -> dict[str, Any]:
    """The bill of materials of a package."""
    packages = needed(name, extras)
    components = [
        _component(found)
        for key, (found, _needs) in sorted(packages.items())
        if key != normal(name)
    ]
    dependencies = [
        {
            "ref": _purl(found),
            "dependsOn": sorted(_purl(packages[need][0]) for need in needs if need in packages),
        }
        for _key, (found, needs) in sorted(packages.items())
    ]
    named = json.dumps([components, dependencies], sort_keys=True)
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, named)}",
        "version": 1,
        "metadata": {"component": {**_component(packages[normal(name)][0]), "type": "application"}},
        "components": components,
        "dependencies": dependencies,
    }


def _component(found: Distribution) -> dict[str, Any]:
    purl = _purl(found)
    component: dict[str, Any] = {
        "type": "library",
        "bom-ref": purl,
        "name": found.name,
        "version": found.version,
        "purl": purl,
    }
    said = found.metadata.get_all("License-Expression") or found.metadata.get_all("License") or []
    licence = next(
        (line.strip() for line in said if line and len(line) < 100 and "\n" not in line.strip()), ""
    )
    classified = [
        c.rsplit(" :: ", 1)[-1]
        for c in found.metadata.get_all("Classifier") or []
        if c.startswith("License")
    ]
    if licence or classified:
        component["licenses"] = [{"license": {"name": licence or classified[0]}}]
    return component


def _purl(found: Distribution) -> str:
    return f"pkg:pypi/{normal(found.name)}@{found.version}"


def main() -> int:
    """Write it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--extra", action="append", default=[])
    options = parser.parse_args()
    found = bill("pomona", options.extra)
    options.out.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    sys.stdout.write(f"{options.out}: {len(found['components'])} packages\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
