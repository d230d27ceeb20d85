"""The experimental tree that picks a wall has no findings with the skills that it names."""

from __future__ import annotations

from pathlib import Path

from pomona.executive.language import check, format_findings, read_file
from pomona.executive.registry import Registry
from pomona.skills.detach import Detach
from pomona.skills.sample_hanging import SampleHanging

TREE = Path(__file__).resolve().parents[2] / "trees" / "experimental" / "pick_tree.yaml"


def test_the_tree_that_picks_a_wall_has_no_findings() -> None:
    skills = Registry({**Registry.installed(), "Detach": Detach, "SampleHanging": SampleHanging})
    assert format_findings(check(read_file(TREE), skills)) == ""
