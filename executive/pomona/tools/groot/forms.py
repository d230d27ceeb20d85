"""How each word is written as XML and read from it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar
from xml.etree.ElementTree import Element

from pomona.executive.nodes.ask import AskType
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.check import CheckType, GuardType, WaitUntilType, WhenType
from pomona.executive.nodes.choosing import IfType, SwitchType
from pomona.executive.nodes.composites import ParallelType, SequenceType
from pomona.executive.nodes.force import ForceType, InvertType
from pomona.executive.nodes.leaves import (
    FailType,
    SetType,
    SkillCall,
    SubtreeCall,
    SucceedType,
    WaitType,
)
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.nodes.pacing import DelayType, RateType, RunOnceType, TimeoutType
from pomona.executive.nodes.repeat import ForEachType, RepeatType
from pomona.executive.nodes.retry import FallbackType, RetryType
from pomona.executive.nodes.working import BreakpointType
from pomona.executive.values.yaml_nodes import YamlMapping, YamlScalar
from pomona.tools.groot.element_in import ElementIn, Words
from pomona.tools.groot.form import XmlForm
from pomona.tools.groot.recovery import RecoveryType
from pomona.tools.groot.turns import PipelineSequenceType, RoundRobinType
from pomona.tools.groot.untranslated import UntranslatedType

if TYPE_CHECKING:
    from pomona.tools.groot.export_xml import LayerXml


class AskForm(XmlForm):
    """`AskType`"""

    attribute = "question"


class ConditionForm(XmlForm):
    """Words with a condition."""

    attribute = "condition"


class IfForm(XmlForm):
    """`IfType`"""

    word: IfType

    def to_xml(self, at: LayerXml) -> Element:
        asked = at.node.children[0]
        at_once = not self.word.reactive or (
            asked.kind == CheckType.key and not asked.modifiers
        )  # see `from_xml`
        return (
            at.element(self.word.other_names[0])
            if at_once and len(at.node.children) == 3
            else at.own({})
        )

    def from_xml(self, element: ElementIn) -> Words:
        children = element.children()
        own = element.tag == self.own_tag
        if not 2 <= len(children) <= 3:
            return element.untranslated(f"has {len(children)} children")
        if self.word.reactive and not own and takes_time(children[0]):
            return element.untranslated(
                "has a condition that takes time: the running branch would continue unattended meanwhile"
            )
        asked: object = children[0]
        if list(children[0]) == ["check"]:
            asked = children[0]["check"]
        found = {self.word.key: asked, "then": children[1]}
        if len(children) == 3:
            return {**found, "else": children[2]}
        return found if own else {**found, "else": {"fail": {}}}


class SwitchForm(XmlForm):
    """`SwitchType`"""

    word: SwitchType

    def to_xml(self, at: LayerXml) -> Element:
        words = self.word.words(at)
        cases = {f"case_{number}": word for number, word in enumerate(words, start=1)}
        known = 2 <= len(words) <= 6 and self.word.has_default(at) and at.plain(self.word.key)
        if known:
            return at.element(f"Switch{len(words)}", {"variable": at.text(self.word.key), **cases})
        return at.own({"variable": at.text(self.word.key), **cases})

    def from_xml(self, element: ElementIn) -> Words:
        children, number = element.children(), 1
        most = len(children) if element.tag == self.own_tag else int(element.tag[-1])
        if element.tag != self.own_tag and len(children) != most + 1:
            return element.untranslated(
                f"has {len(children)} children instead of {most} cases and a default"
            )
        cases: Words = {}
        while f"case_{number}" in element.attributes and number <= min(most, len(children)):
            cases[element.get(f"case_{number}")] = children[number - 1]
            number += 1
        rest = children[number - 1 :]
        if (
            not cases
            or len(rest) > 1
            or len(cases) != number - 1
            or any("{" in word for word in cases)
        ):
            return element.untranslated("has cases that are no words, or that stand twice")
        found: Words = {self.word.key: element.value("variable"), "cases": cases}
        return {**found, "default": rest[0]} if rest else found


class ForceForm(XmlForm):
    """`ForceType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.element("ForceFailure" if at.text(self.word.key) == "failure" else "ForceSuccess")

    def from_xml(self, element: ElementIn) -> Words:
        (child,) = element.children()
        return element.wrap(
            child, self.word.key, "failure" if element.tag == "ForceFailure" else "success"
        )


class InvertForm(XmlForm):
    """`InvertType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.element("Inverter")

    def from_xml(self, element: ElementIn) -> Words:
        (child,) = element.children()
        return element.wrap(child, self.word.key, True)


class WaitForm(XmlForm):
    """`WaitType`"""

    attribute = "duration"

    def to_xml(self, at: LayerXml) -> Element:
        milliseconds = at.milliseconds(self.word.key)
        return at.element("Sleep", {"msec": milliseconds}) if milliseconds else super().to_xml(at)

    def from_xml(self, element: ElementIn) -> Words:
        return (
            {self.word.key: element.duration("msec")}
            if element.tag == "Sleep"
            else super().from_xml(element)
        )


class SetForm(XmlForm):
    """`SetType`"""

    attribute = "values"

    def attributes(self, at: LayerXml) -> dict[str, str]:
        return {"values": at.text(self.word.key)}

    def from_xml(self, element: ElementIn) -> Words:
        return {self.word.key: element.value("values") or {}}


class SucceedForm(XmlForm):
    """`SucceedType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.element("AlwaysSuccess")

    def from_xml(self, element: ElementIn) -> Words:
        return {self.word.key: {}}


class FailForm(XmlForm):
    """`FailType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return super().to_xml(at) if at.node.ports else at.element("AlwaysFailure")

    def from_xml(self, element: ElementIn) -> Words:
        return {self.word.key: element.ports() if element.tag == self.own_tag else {}}


class SkillCallForm(XmlForm):
    """`SkillCall`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.skill()

    def from_xml(self, element: ElementIn) -> Words:
        if element.children():
            return element.untranslated("has children, which a skill cannot have")
        return {element.tag: element.ports()}


class SubtreeCallForm(XmlForm):
    """`SubtreeCall`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.subtree()


class DelayForm(XmlForm):
    """`DelayType`"""

    attribute = "duration"

    def to_xml(self, at: LayerXml) -> Element:
        milliseconds = at.milliseconds(self.word.key)
        return (
            at.element("Delay", {"delay_msec": milliseconds})
            if milliseconds
            else super().to_xml(at)
        )

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        (child,) = element.children()
        return element.wrap(child, self.word.key, element.duration("delay_msec"))


class RateForm(XmlForm):
    """`RateType`"""

    attribute = "rate"

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        (child,) = element.children()
        hz = str(element.value("hz") or "10.0")
        return element.wrap(
            child, self.word.key, f"{hz} * 1 Hz" if hz.startswith("{") else f"{hz} Hz"
        )


class RunOnceForm(XmlForm):
    """`RunOnceType`"""

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == "RunOnce" and (element.get("then_skip") or "true") not in ("true", "1"):
            return element.untranslated("repeats its first result instead of being skipped")
        (child,) = element.children()
        return element.wrap(child, self.word.key, True)

    def to_xml(self, at: LayerXml) -> Element:
        return at.element("RunOnce")


class TimeoutForm(XmlForm):
    """`TimeoutType`"""

    attribute = "duration"

    def to_xml(self, at: LayerXml) -> Element:
        milliseconds = at.milliseconds(self.word.key)
        return at.element("Timeout", {"msec": milliseconds}) if milliseconds else super().to_xml(at)

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        (child,) = element.children()
        limit = element.duration("msec")
        return (
            child if limit == "0 s" else element.wrap(child, self.word.key, limit)
        )  # 0 sets no timer


class ParallelForm(XmlForm):
    """`ParallelType`"""

    def to_xml(self, at: LayerXml) -> Element:
        success_on = at.text("success_on") or "all"
        count = {"all": "-1", "one": "1"}.get(success_on, success_on)
        if not count.removeprefix("-").isdecimal():
            return at.own({"success_on": success_on})
        return at.element("Parallel", {"success_count": count, "failure_count": "1"})

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return {
                "parallel": element.children(),
                "success_on": element.value("success_on") or "all",
            }
        children = element.children()
        if element.tag == "ParallelAll":
            if len(children) > 1 or element.get("max_failures") not in ("", "1", "-1"):
                return element.untranslated("lets all children end before it fails")
            return {"parallel": children}
        success, failure = element.get("success_count") or "-1", element.get("failure_count") or "1"
        everything = success == "-1" or (success != "1" and success == str(len(children)))
        if everything and failure.isdecimal() and 0 < int(failure) <= len(children):
            failure = "1"  # the first failure leaves too few to succeed
        if failure != "1" or not (
            everything or (success.isdecimal() and 0 < int(success) <= len(children))
        ):
            return element.untranslated(f"succeeds on {success} and fails on {failure}")
        if everything:
            return {"parallel": children}
        return {"parallel": children, "success_on": "one" if success == "1" else int(success)}


class RepeatForm(XmlForm):
    """`RepeatType`"""

    word: RepeatType
    attribute = "rounds"

    def to_xml(self, at: LayerXml) -> Element:
        if self.word.forever(at):
            return at.element("Repeat", {"num_cycles": "-1"})
        if not at.plain(self.word.key):
            return super().to_xml(at)
        return at.element("Repeat", {"num_cycles": at.text(self.word.key)})

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        (child,) = element.children()
        if element.tag == "KeepRunningUntilFailure" and may_skip(
            child
        ):  # it goes on when its child is skipped
            child = {"sequence": [child, {"succeed": {}}]}
        forever = element.tag == "KeepRunningUntilFailure" or element.get("num_cycles") == "-1"
        return element.wrap(
            child, self.word.key, "forever" if forever else element.count("num_cycles")
        )


class ForEachForm(XmlForm):
    """`ForEachType`"""

    attribute = "items"
    names: ClassVar[Mapping[str, str]] = {"as": "item"}

    def attributes(self, at: LayerXml) -> dict[str, str]:
        return {"items": at.text(self.word.key), "item": f"{{{at.text('as') or 'item'}}}"}

    def from_xml(self, element: ElementIn) -> Words:
        (child,) = element.children()
        return element.wrap(
            child, self.word.key, element.value("items"), {"as": element.get("item").strip("{}")}
        )


class RetryForm(XmlForm):
    """`RetryType`"""

    attribute = "attempts"

    def to_xml(self, at: LayerXml) -> Element:
        if self.word.fields.keys() & at.node.modifiers.keys() or not at.plain(self.word.key):
            return super().to_xml(at)
        return at.element("RetryUntilSuccessful", {"num_attempts": at.text(self.word.key)})

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        (child,) = element.children()
        if (
            element.get("num_attempts") == "-1"
        ):  # for ever: until a success ends the repetition of failures
            repeated = element.wrap(element.wrap(child, "invert", True), "repeat", "forever")
            return element.wrap(repeated, "invert", True)
        return element.wrap(child, self.word.key, element.count("num_attempts"))


class FallbackForm(XmlForm):
    """`FallbackType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.element(self.word.other_names[0])


class SequenceForm(XmlForm):
    """`SequenceType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.element(self.word.other_names[0])


class BreakpointForm(XmlForm):
    """`BreakpointType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.own({"value": at.text(self.word.key)})


class RecoveryForm(XmlForm):
    """`RecoveryType`"""

    def from_xml(self, element: ElementIn) -> Words:
        if element.tag == self.own_tag:
            return super().from_xml(element)
        retries, children = element.get("number_of_retries") or "1", element.children()
        if not retries.isdigit() or len(children) != 2:
            return element.untranslated(f"has {len(children)} children and {retries} retries")
        return {self.word.key: children, "attempts": str(int(retries) + 1)}


class RoundRobinForm(XmlForm):
    """`RoundRobinType`"""

    def from_xml(self, element: ElementIn) -> Words:
        if element.get("wrap_around") in ("false", "0"):
            return element.untranslated("does not begin again after its last child")
        return {self.word.key: element.children()}


class PipelineSequenceForm(XmlForm):
    """`PipelineSequenceType`"""

    def to_xml(self, at: LayerXml) -> Element:
        return at.own({})


class UntranslatedForm(XmlForm):
    """`UntranslatedType`"""

    word: UntranslatedType

    def to_xml(self, at: LayerXml) -> Element:
        entry = at.node.modifiers.get("attributes")
        written = (
            entry[1].entries.values()
            if entry is not None and isinstance(entry[1], YamlMapping)
            else ()
        )
        given = {key.text: value.text for key, value in written if isinstance(value, YamlScalar)}
        return at.element(self.word.element(at.node), given)


def takes_time(words: object) -> bool:
    """Return True if a node as plain values surely runs for more than a tick."""
    if isinstance(words, dict):
        slow = words.keys() & {
            "wait",
            "wait_until",
            "delay",
            "rate",
            "ask",
            "retry",
            "repeat",
            "for_each",
        }
        return bool(slow) or any(map(takes_time, words.values()))
    return isinstance(words, list) and any(map(takes_time, words))


def may_skip(words: object) -> bool:
    """Return True if a node as plain values could be skipped; a subtree is not looked into."""
    if isinstance(words, dict):
        chooses = words.keys() & {"when", "run_once", "if", "reactive_if", "switch", "disabled"}
        return (
            bool(chooses)
            or any(map(may_skip, words.values()))
            or any(str(w)[:1].islower() for w in called(words))
        )
    return isinstance(words, list) and any(map(may_skip, words))


def called(words: Words) -> list[str]:
    """Return words that may call a subtree, which may be skipped."""
    return [
        word
        for word, value in words.items()
        if isinstance(value, dict) and word not in _NEVER_SKIPPED
    ]


_NEVER_SKIPPED = frozenset({"succeed", "fail", "set", "attributes"})


FORMS: Mapping[type[NodeType], type[XmlForm]] = {
    AskType: AskForm,
    CheckType: ConditionForm,
    WaitUntilType: ConditionForm,
    GuardType: ConditionForm,
    WhenType: ConditionForm,
    IfType: IfForm,
    SwitchType: SwitchForm,
    ForceType: ForceForm,
    InvertType: InvertForm,
    WaitType: WaitForm,
    SetType: SetForm,
    SucceedType: SucceedForm,
    FailType: FailForm,
    SkillCall: SkillCallForm,
    SubtreeCall: SubtreeCallForm,
    DelayType: DelayForm,
    RateType: RateForm,
    RunOnceType: RunOnceForm,
    TimeoutType: TimeoutForm,
    ParallelType: ParallelForm,
    RepeatType: RepeatForm,
    ForEachType: ForEachForm,
    RetryType: RetryForm,
    FallbackType: FallbackForm,
    SequenceType: SequenceForm,
    BreakpointType: BreakpointForm,
    RecoveryType: RecoveryForm,
    RoundRobinType: RoundRobinForm,
    PipelineSequenceType: PipelineSequenceForm,
    UntranslatedType: UntranslatedForm,
}
"""Forms by the class of a word. Classes below it have the same form, all other words the plain `XmlForm`."""


class Forms:
    """The forms of all words."""

    def __init__(self, types: NodeTypes) -> None:
        self._types = types
        self._own = {form_of(word).own_tag: word for word in types.values()}

    def of_tag(self, tag: str) -> XmlForm | None:
        """Return the form that reads an element; None if no word stands for it."""
        word = self._own.get(tag) or self._types.of_other_name(tag)
        return None if word is None else form_of(word)


def form_of(word: NodeType) -> XmlForm:
    """Return a word's form."""
    return next((FORMS[each] for each in type(word).__mro__ if each in FORMS), XmlForm)(word)
