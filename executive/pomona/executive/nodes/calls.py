"""Leaves that call a skill or a subtree by name. The language looks the name up."""

from __future__ import annotations

from py_trees.behaviour import Behaviour

from pomona.executive.nodes import takes
from pomona.executive.nodes.context import BuildContext, CheckContext, OutcomeContext, Words, XmlExport, XmlImport
from pomona.executive.nodes.ends import Outcome
from pomona.executive.nodes.node_type import Leaf, Stage


class SkillCall(Leaf):
    """a skill; names begin with a capital"""

    key, symbol, colour = "skill", "●", "#0b6e4f"
    value = takes.Ports()
    calls = True

    def declare(self, at: CheckContext, stage: Stage) -> None:
        if stage is Stage.DECLARED:
            at.look_up_skill()
        elif stage is Stage.UNKNOWN:
            at.mark_outputs_unknown()

    def check_layer(self, at: CheckContext) -> None:
        at.check_call()

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.skill()

    def build(self, at: BuildContext) -> Behaviour:
        return at.skill()

    def to_xml(self, at: XmlExport) -> object:
        return at.skill()

    def from_xml(self, element: XmlImport) -> Words:
        if element.children():
            return element.untranslated("has children, which a skill cannot have")
        return {element.tag: element.ports()}


class SubtreeCall(Leaf):
    """a subtree of this file, or of another"""

    key, symbol, colour = "subtree", "▣", "#6c4ab6"
    value = takes.Ports()
    calls = True

    def declare(self, at: CheckContext, stage: Stage) -> None:
        if stage is Stage.DECLARED:
            at.look_up_subtree()
        elif stage is Stage.UNKNOWN:
            at.mark_outputs_unknown()

    def check_layer(self, at: CheckContext) -> None:
        at.check_call()

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.subtree()

    def build(self, at: BuildContext) -> Behaviour:
        return at.subtree()

    def to_xml(self, at: XmlExport) -> object:
        return at.subtree()


SKILL, SUBTREE = SkillCall(), SubtreeCall()
