"""Every word that a shipped skill puts before a user, port or failure code, is in the glossary, and no other."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive.language.declared_skills import declared_skills

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "glossary.md").read_text("utf-8")


def explained(section: str) -> set[str]:
    """The words in the first column of a section's table."""
    rows = re.findall(r"^\| (`[^|]*) \|", PAGE.partition(f"\n## {section}\n")[2].partition("\n## ")[0], re.MULTILINE)
    return {word for row in rows for word in re.findall(r"`([^`]*)`", row)}


def test_the_glossary_explains_every_failure_code_and_every_port_and_no_other() -> None:
    ours = ("pomona.skills.", "pomona.applications.")
    skills = [skill for skill in declared_skills().listing() if skill.module.startswith(ours)]
    assert len(skills) > 15, "the skills were not found"
    assert explained("Failure codes") == {code for skill in skills for code in skill.failures}
    assert explained("Ports") == {port["name"] for skill in skills for port in (*skill.inputs, *skill.outputs)}
