"""Every word that a shipped skill puts before a user, port or failure code, is explained where it is declared.

The site's lists of ports and codes are made from these declarations (scripts/docs_pages.py).
"""

from __future__ import annotations

from pomona.executive.reasons import failure_codes
from pomona.executive.registry import Registry


def test_every_port_and_every_failure_code_is_explained() -> None:
    skills = [
        skill for skill in Registry.installed().listing() if skill.module.startswith("pomona.")
    ]
    assert len(skills) > 15, "the skills were not found"
    ports = [port for skill in skills for port in (*skill.inputs, *skill.outputs)]
    explained = {port["name"] for port in ports if port.get("help", "").strip()}
    assert {port["name"] for port in ports} - explained == set(), (
        "give its Port a help in one skill at least"
    )
    assert {code for skill in skills for code in skill.failures} - failure_codes().keys() == set()
    for known in failure_codes().values():
        assert known.meaning.strip(), known.code
        assert known.remedy.strip(), known.code
