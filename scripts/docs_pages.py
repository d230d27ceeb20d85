"""Pages of the documentation that follow from the code, in addition to those in docs/.

Run by mkdocs (the plugin gen-files). The README is the overview; commands come from their parsers, skills and ports
from their declarations, nodes from their types with a drawn example each, failure codes from their file, modules from
their docstrings, and model cards from their folder.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path

import mkdocs_gen_files

from pomona.executive.commands.command_line import children, command_names, make_parser
from pomona.executive.nodes import Composite, Leaf, Modifier, NodeType, NodeTypes
from pomona.executive.reasons import failure_codes
from pomona.executive.registry import Registry, SkillListing
from pomona.executive.values.public_names import full_name
from scripts.node_examples import beside

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

MODULES = (
    "pomona.executive.skill",
    "pomona.executive.ports",
    "pomona.executive.skill_testing",
    "pomona.executive.execute",
    "pomona.executive.views",
    "pomona.executive.recording.read",
    "pomona.executive.cell.errors",
    "pomona.drivers.interfaces",
    "pomona.drivers.errors",
    "pomona.skills.geometry",
    "pomona.skills.motion.robot.model",
    "pomona.skills.motion.collision.world",
    "pomona.skills.motion.planning.plan",
    "pomona.skills.motion.grasps.sphere",
    "pomona.skills.motion.occupancy.occupancy_map",
    "pomona.skills.grip.limit_surface",
    "pomona.skills.grip.controller",
    "pomona.skills.grip.hold",
    "pomona.skills.grip.settings",
    "pomona.skills.perception.detection.compact_detector",
    "pomona.skills.perception.refinement.measure",
    "pomona.skills.perception.fruit.catalogue",
)
"""Modules for integrators."""


PACKAGES = (
    "pomona.executive",
    "pomona.drivers",
    "pomona.tools.simulation",
    "pomona.skills",
    "pomona.skills.motion",
    "pomona.skills.perception",
    "pomona.skills.grip",
)
"""Packages with public names."""


def write(name: str, text: str) -> None:
    """Add a page."""
    with mkdocs_gen_files.open(name, "w") as page:
        page.write(text)


def overview() -> str:
    """The README; links into docs/ stay links, links to sources become plain names."""
    text = (ROOT / "README.md").read_text("utf-8")

    def link(found: re.Match[str]) -> str:
        words, target = found[1], found[2]
        if target.startswith("http"):
            return found[0]
        return f"[{words}]({target[5:]})" if target.startswith("docs/") else f"`{target}`"

    return re.sub(r"(?<!!)\[([^\]]*)\]\(([^)]*)\)", link, text).replace(
        "](docs/images/", "](images/"
    )


def commands(parser: argparse.ArgumentParser, path: str = "pomona") -> Iterator[str]:
    """A parser's help and that of all below it."""
    yield f"## {path}\n\n```text\n{parser.format_help().rstrip()}\n```\n"
    for name, _help, below in children(parser):
        yield from commands(below, f"{path} {name}")


def skill(listing: SkillListing) -> str:
    """Return one skill: its function, its ports, devices and failure codes."""
    parts = [f"## {listing.name}\n\n{listing.summary}\n"]
    for title, ports in (("Input", listing.inputs), ("Output", listing.outputs)):
        if ports:
            parts.append(f"| {title} | type | default | meaning |\n|---|---|---|---|")
            for port in ports:
                default = port.get("default")
                shown = "" if default in (None, "") else f"`{default}`"
                parts.append(
                    f"| `{port['name']}` | {port['type']} | {shown} | {port.get('help', '')} |"
                )
            parts.append("")
    if listing.devices:
        parts.append(f"Devices: {', '.join(f'`{device}`' for device in listing.devices)}.\n")
    if listing.failures:
        links = ", ".join(f"[`{code}`](failures.md#{code.lower()})" for code in listing.failures)
        parts.append(f"Fails with: {links}.\n")
    return "\n".join(parts)


def nodes(title: str, types: list[NodeType]) -> Iterator[str]:
    """Yield the words of one kind of node type: function, fields, and an example with its drawing."""
    yield f"## {title}\n"
    for node in types:
        yield f"### {node.key}\n\n{' '.join(node.summary.split()).capitalize()}.\n"
        fields = [(word, each.help, each.required) for word, each in node.fields.items()]
        if fields:
            words = [(node.key, node.value.help if node.value else "", False), *fields]
            rows = [
                f"| `{word}`{' (needed)' if needed else ''} | {told} |"
                for word, told, needed in words
            ]
            yield "| word | stands behind it |\n|---|---|\n" + "\n".join(rows) + "\n"
        yield beside(node.key)


def failures(listing: Sequence[SkillListing]) -> str:
    """Return every failure code: its meaning, remedy, and the skills that fail with it."""
    raised: dict[str, list[str]] = {}
    for one in listing:
        for code in one.failures:
            raised.setdefault(code, []).append(f"[{one.name}](skills.md#{one.name.lower()})")
    rows = [
        f"| <span id='{known.code.lower()}'></span>`{known.code}` | {known.meaning} | {known.remedy} |"
        f" {', '.join(raised.get(known.code, ['the language, the runner']))} |"
        for known in failure_codes().values()
    ]
    intro = "Causes of failures and their remedies. `pomona explain` ends with the remedy of the code that ended a run."
    head = "| code | meaning | remedy | fails with it |\n|---|---|---|---|\n"
    return f"---\nhide: [toc]\n---\n\n# Failure codes\n\n{intro}\n\n{head}" + "\n".join(rows) + "\n"


def ports(listing: Sequence[SkillListing]) -> str:
    """Return every port by its name: each meaning with the skills that give it."""
    found: dict[str, dict[str, dict[str, None]]] = {}
    for one in listing:
        for port in (*one.inputs, *one.outputs):
            users = found.setdefault(str(port["name"]), {}).setdefault(
                str(port.get("help", "")), {}
            )
            users[f"[{one.name}](skills.md#{one.name.lower()})"] = None
    rows = [
        f"| `{name}` | {meaning} | {', '.join(users)} |"
        for name, meanings in sorted(found.items())
        for meaning, users in sorted(
            meanings.items(), reverse=True
        )  # skills without a help of their own come last
    ]
    intro = "Inputs and outputs of the skills by name. [Skills](skills.md) has their types, ranges and defaults."
    head = "| port | meaning | skills |\n|---|---|---|\n"
    return f"---\nhide: [toc]\n---\n\n# Ports\n\n{intro}\n\n{head}" + "\n".join(rows) + "\n"


def public_names(package: str) -> str:
    """Return a package's public names, by the purpose of the modules that define them."""
    rows = []
    for home, names in import_module(package).PUBLIC.items():
        purpose = (import_module(full_name(package, home)).__doc__ or "").split("\n\n")[0]
        rows.append(
            f"| {' '.join(purpose.split())} | {', '.join(f'`{name}`' for name in names.split())} |"
        )
    return f"## {package}\n\n| | names |\n|---|---|\n" + "\n".join(rows) + "\n"


def title_of(page: Path) -> str:
    """The first heading of a page."""
    found = re.search(r"^# (.+)$", page.read_text("utf-8"), re.MULTILINE)
    return found[1] if found else page.stem


def listed(pages: list[Path]) -> str:
    """A list of pages in docs/, as links."""
    return (
        "\n".join(f"- [{title_of(page)}](../{page.relative_to(DOCS).as_posix()})" for page in pages)
        + "\n"
    )


write("overview.md", overview())
write("reference/commands.md", "# Commands\n\n" + "\n".join(commands(make_parser(command_names()))))
own = [one for one in Registry.installed().listing() if one.module.startswith("pomona.")]
write("reference/skills.md", "# Skills\n\n" + "\n".join(skill(one) for one in own))
write("reference/failures.md", failures(own))
kinds = {
    "Composites": Composite,
    "Modifiers, from the inside to the outside": Modifier,
    "Leaves": Leaf,
}
listed_types = list(NodeTypes.installed().values())
write(
    "reference/nodes.md",
    "# Nodes\n\nThe words of [the tree language](../tree_language.md) as their classes declare them.\n\n"
    + "\n".join(
        part
        for title, kind in kinds.items()
        for part in nodes(title, [t for t in listed_types if isinstance(t, kind)])
    ),
)
write(
    "reference/public_names.md",
    "# Public names\n\nDevices, applications and packages of others import these names from these packages, and no "
    "others. [Stable interfaces](../stability.md) has the rules by which they change.\n\n"
    + "\n".join(public_names(package) for package in PACKAGES),
)
for name in MODULES:
    write(f"reference/modules/{name}.md", f"# {name.removeprefix('pomona.')}\n\n::: {name}\n")
links = "\n".join(f"- [`{name}`](modules/{name}.md)" for name in MODULES)
write(
    "reference/modules.md",
    f"# Modules\n\nWhat an integrator calls; each module has a page.\n\n{links}\n",
)
write("reference/ports.md", ports(own))
write(
    "reference/model_cards.md",
    f"# Model cards\n\n{listed(sorted((DOCS / 'model_cards').glob('*.md')))}",
)
