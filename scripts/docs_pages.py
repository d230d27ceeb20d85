"""Pages of the documentation that follow from the code: what mkdocs shows beside what stands in docs/.

Run by mkdocs (the plugin gen-files). The README is the first page; commands come from their parsers, skills from their
declarations, modules from their docstrings, and decisions and reports from their folders.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import mkdocs_gen_files

from pomona.executive.commands.command_line import children, command_names, make_parser
from pomona.executive.language.declared_skills import declared_skills
from pomona.executive.nodes import Composite, Leaf, Modifier, NodeType, NodeTypes
from pomona.executive.registry import SkillListing

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"

MODULES = (
    "pomona.executive.skill",
    "pomona.executive.ports",
    "pomona.executive.skill_testing",
    "pomona.executive.execute",
    "pomona.executive.views",
    "pomona.executive.recording.read",
    "pomona.drivers.interfaces",
    "pomona.drivers.errors",
    "pomona.skills.geometry",
    "pomona.skills.motion.robot.model",
    "pomona.skills.motion.collision.world",
    "pomona.skills.motion.planning.plan",
    "pomona.skills.motion.planning.planners",
    "pomona.skills.motion.grasps.sphere",
    "pomona.skills.motion.occupancy.occupancy_map",
    "pomona.skills.grip.limit_surface",
    "pomona.skills.grip.controller",
    "pomona.skills.grip.hold",
    "pomona.skills.grip.settings",
    "pomona.skills.perception.detection.compact_detector",
    "pomona.skills.perception.refinement.refinement",
    "pomona.skills.perception.fruit.catalogue",
)
"""What an integrator calls."""


def write(name: str, text: str) -> None:
    """Add a page."""
    with mkdocs_gen_files.open(name, "w") as page:
        page.write(text)


def first_page() -> str:
    """The README; links into docs/ stay links, links to sources become plain names."""
    text = (ROOT / "README.md").read_text("utf-8")

    def link(found: re.Match[str]) -> str:
        words, target = found[1], found[2]
        if target.startswith("http"):
            return found[0]
        if target == "docs/decisions/":
            return f"[{words}](reference/decisions.md)"
        return f"[{words}]({target[5:]})" if target.startswith("docs/") else f"`{target}`"

    return re.sub(r"(?<!!)\[([^\]]*)\]\(([^)]*)\)", link, text).replace("](docs/images/", "](images/")


def commands(parser: argparse.ArgumentParser, path: str = "pomona") -> Iterator[str]:
    """A parser's help and that of all below it."""
    yield f"## {path}\n\n```text\n{parser.format_help().rstrip()}\n```\n"
    for name, _help, below in children(parser):
        yield from commands(below, f"{path} {name}")


def skill(listing: SkillListing) -> str:
    """One skill: what it does, its ports, devices and failure codes."""
    parts = [f"## {listing.name}\n\n{listing.summary}\n"]
    for title, ports in (("Input", listing.inputs), ("Output", listing.outputs)):
        if ports:
            parts.append(f"| {title} | type | default | |\n|---|---|---|---|")
            for port in ports:
                default = port.get("default")
                shown = "" if default in (None, "") else f"`{default}`"
                parts.append(f"| `{port['name']}` | {port['type']} | {shown} | {port.get('help', '')} |")
            parts.append("")
    for title, words in (("Devices", listing.devices), ("Fails with", listing.failures)):
        if words:
            parts.append(f"{title}: {', '.join(f'`{word}`' for word in words)}.\n")
    return "\n".join(parts)


def nodes(title: str, types: list[NodeType]) -> str:
    """The words of one kind of node type: what each does, and what may stand beside it."""
    rows = []
    for node in types:
        rows.append(f"| `{node.key}` | {' '.join(node.summary.split())} | {node.value.help if node.value else ''} |")
        rows += [
            f"| | `{word}`{' (needed)' if each.required else ''} | {each.help} |" for word, each in node.fields.items()
        ]
    return f"## {title}\n\n| word | what it does | what stands behind it |\n|---|---|---|\n" + "\n".join(rows) + "\n"


def title_of(page: Path) -> str:
    """The first heading of a page."""
    found = re.search(r"^# (.+)$", page.read_text("utf-8"), re.MULTILINE)
    return found[1] if found else page.stem


def listed(title: str, intro: str, pages: list[Path]) -> str:
    """A page of links to pages in docs/."""
    lines = [f"- [{title_of(page)}](../{page.relative_to(DOCS).as_posix()})" for page in pages]
    return f"# {title}\n\n{intro}\n\n" + "\n".join(lines) + "\n"


DECISION = re.compile(r"^\*Decision (\d+) · (\d{4}-\d\d-\d\d) · ([^*\n]+)\*$", re.MULTILINE)


def decisions(pages: list[Path]) -> str:
    """Return the index of decisions, the newest first: those in force, then the archive."""
    tables: dict[bool, list[tuple[int, str]]] = {True: [], False: []}
    for page in pages:
        number, date, status = DECISION.search(page.read_text("utf-8")).groups()  # type: ignore[union-attr]
        link = f"[{title_of(page)}](../{page.relative_to(DOCS).as_posix()})"
        tables[status == "in force"].append((int(number), f"| {number} | {link} | {date} | {status} |"))
    head = "| | decision | taken | status |\n|---|---|---|---|\n"
    force, archive = (
        head + "\n".join(row for _number, row in sorted(tables[key], reverse=True)) for key in (True, False)
    )
    return (
        f"# Decisions\n\nDesign decisions with their measurements.\n\n{force}\n\n## Archive\n\n"
        f"Approaches that were tried and not kept, and decisions that a later one replaced.\n\n{archive}\n"
    )


write("index.md", first_page())
write("reference/commands.md", "# Commands\n\n" + "\n".join(commands(make_parser(command_names()))))
write("reference/skills.md", "# Skills\n\n" + "\n".join(skill(one) for one in declared_skills().listing()))
kinds = {"Composites": Composite, "Modifiers, from the inside to the outside": Modifier, "Leaves": Leaf}
listed_types = list(NodeTypes.installed().values())
write(
    "reference/nodes.md",
    "# Nodes\n\nThe words of [the tree language](../tree_language.md) as their classes declare them.\n\n"
    + "\n".join(nodes(title, [t for t in listed_types if isinstance(t, kind)]) for title, kind in kinds.items()),
)
write("reference/modules.md", "# Modules\n\n" + "\n".join(f"::: {name}\n" for name in MODULES))
write("reference/decisions.md", decisions(sorted((DOCS / "decisions").glob("*.md"))))
write(
    "reference/reports.md",
    listed(
        "Reports and model cards",
        "What was measured, with the command that repeats it.",
        [*sorted((DOCS / "reports").glob("*/*.md")), *sorted((DOCS / "model_cards").glob("*.md"))],
    ),
)
