"""The nodes of BehaviorTree.CPP that tree files have, too: each element becomes a node or a modifier."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from pomona.tools.groot.element_in import ElementIn, Words
from pomona.tools.groot.keys import NAME, NoEquivalentError, key_in
from pomona.tools.groot.names import COMPOSITES
from pomona.tools.groot.scripts import assignments_of, condition_of, statements_of
from pomona.tools.groot.yaml_text import Written

_SAME_FAILURE: Words = {"fail": {"code": "{failure.code}", "message": "{failure.message}"}}
"""Fails with the code and message of the last failure."""


class Wrapped(NamedTuple):
    """A node with one more modifier."""

    child: Words
    word: str
    value: object


def composite(element: ElementIn) -> Words:
    """`Sequence`, `Fallback` and the like."""
    return {COMPOSITES[element.tag]: element.children()}


def parallel(element: ElementIn) -> Words:
    """`Parallel`: the first failure ends it, or it cannot be translated.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    children = element.children()
    success = element.get("success_count", "-1")
    failure = element.get("failure_count", "1")
    everything = success == "-1" or (success != "1" and success == str(len(children)))
    if everything and failure.isdecimal() and 0 < int(failure) <= len(children):
        failure = "1"  # the first failure leaves too few to succeed
    known = everything or (success.isdecimal() and 0 < int(success) <= len(children))
    if failure != "1" or not known:
        why = f"succeeds on {success} and fails on {failure} of {len(children)}"
        raise NoEquivalentError(
            why, "a parallel fails with the first failure: split it, or force a success"
        )
    if everything:
        return {"parallel": children}
    return {"parallel": children, "success_on": "one" if success == "1" else int(success)}


def if_then_else(element: ElementIn) -> Words:
    """`IfThenElse`. With two children, BehaviorTree.CPP may keep a failed condition when it is started again.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    if len(element.found.children) == 2:
        hint = "give it <AlwaysFailure/> as its third child"
        raise NoEquivalentError("has no third child, which runs when the first fails", hint)
    asked, then, otherwise = element.children(3)
    return {"if": asked.get("check", asked), "then": then, "else": otherwise}


def while_do_else(element: ElementIn) -> Words:
    """`WhileDoElse`, whose first child ends in the tick in which it starts."""
    asked, then, *otherwise = element.children(2, 3)
    found: Words = {"reactive_if": asked.get("check", asked), "then": then}
    return {**found, "else": otherwise[0] if otherwise else {"fail": {}}}


def switch(element: ElementIn) -> Words:
    """`Switch2` to `Switch6`.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    number = int(element.tag[-1])
    *nodes, default = element.children(number + 1)
    words = [Written(element.get(f"case_{i}")) for i in range(1, number + 1)]
    if len(set(words)) < number or any("{" in word or not word for word in words):
        raise NoEquivalentError("has cases that are no words, or that stand twice", "correct them")
    cases = dict(zip(words, nodes, strict=True))
    return {"switch": element.value("variable"), "cases": cases, "default": default}


def wrapped(word: str, value: Callable[[ElementIn], object]) -> Callable[[ElementIn], Wrapped]:
    """Return the reader of a decorator that is a modifier."""

    def read(element: ElementIn) -> Wrapped:
        (child,) = element.children(1)
        return Wrapped(child, word, value(element))

    return read


def timeout(element: ElementIn) -> Words | Wrapped:
    """`Timeout`, which sets no timer for 0 ms."""
    (child,) = element.children(1)
    limit = element.duration("msec")
    return child if limit == "0 s" else Wrapped(child, "timeout", limit)


def repeat(element: ElementIn) -> Wrapped:
    """`Repeat`"""
    (child,) = element.children(1)
    forever = element.get("num_cycles") == "-1"
    return Wrapped(child, "repeat", "forever" if forever else element.count("num_cycles"))


def keep_running(element: ElementIn) -> Words:
    """`KeepRunningUntilFailure`, which goes on when its child is skipped."""
    return {"sequence": [*element.children(1), {"succeed": {}}], "repeat": "forever"}


def retry(element: ElementIn) -> Words | Wrapped:
    """`RetryUntilSuccessful`; for ever it repeats failures until a success ends that."""
    (child,) = element.children(1)
    if element.get("num_attempts") != "-1":
        return Wrapped(child, "retry", element.count("num_attempts"))
    failing = {"sequence": [child], "invert": True, "repeat": "forever"}
    return {"sequence": [failing], "invert": True}


def run_once(element: ElementIn) -> Wrapped:
    """`RunOnce`, which is skipped after its first end.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    (child,) = element.children(1)
    if element.get("then_skip", "true") not in ("true", "1"):
        raise NoEquivalentError("repeats its first result instead of being skipped")
    return Wrapped(child, "run_once", True)


def precondition(element: ElementIn) -> Words:
    """`Precondition`: evaluated once, at its start.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    ends: Mapping[str, Words] = {
        "FAILURE": {"else": {"fail": {}}},
        "SUCCESS": {"else": {"succeed": {}}},
        "SKIPPED": {},
    }
    (child,) = element.children(1)
    end = element.get("else", "FAILURE")
    if end not in ends:
        raise NoEquivalentError(f"ends as {end}")
    return {
        "if": Written(condition_of(element.get("if"), element.keys)),
        "then": child,
        **ends[end],
    }


def script(element: ElementIn) -> Words:
    """`Script`, and `ScriptCondition`, whose last statement is a condition."""
    element.children(0)
    statements = statements_of(element.get("code"))
    last = statements.pop() if element.tag == "ScriptCondition" and statements else ""
    steps: list[Words] = []
    if statements or not last:
        steps = [
            {"set": {name: value}}
            for name, value in assignments_of(";".join(statements), element.keys)
        ]
    if last:
        steps.append({"check": Written(condition_of(last, element.keys))})
    return steps[0] if len(steps) == 1 else {"sequence": steps}


def set_blackboard(element: ElementIn) -> Words:
    """`SetBlackboard` copies a text or a wire to a key.

    Raises NoEquivalentError: it has no equivalent in a tree file.
    """
    element.children(0)
    written = element.get("output_key")
    if not written or "value" not in element.found.attributes or key_in(written, "") is not None:
        raise NoEquivalentError("names no value, or no key but one that holds its name")
    name = element.keys.target(written)
    if not NAME.fullmatch(name):
        raise NoEquivalentError(f"writes '{written}', which no name here can be", "rename the key")
    return {"set": {name: element.value("value")}}


def leaf(word: str, attribute: str = "") -> Callable[[ElementIn], Words]:
    """Return the reader of an element without children; `attribute` has a duration."""

    def read(element: ElementIn) -> Words:
        element.children(0)
        return {word: element.duration(attribute) if attribute else {}}

    return read


READERS: Mapping[str, Callable[[ElementIn], Words | Wrapped]] = {
    **dict.fromkeys(COMPOSITES, composite),
    **dict.fromkeys([f"Switch{number}" for number in range(2, 7)], switch),
    "Parallel": parallel,
    "IfThenElse": if_then_else,
    "WhileDoElse": while_do_else,
    "Precondition": precondition,
    "Inverter": wrapped("invert", lambda _: True),
    "ForceSuccess": wrapped("force", lambda _: "success"),
    "ForceFailure": wrapped("force", lambda _: "failure"),
    "Delay": wrapped("delay", lambda element: element.duration("delay_msec")),
    "Timeout": timeout,
    "Repeat": repeat,
    "KeepRunningUntilFailure": keep_running,
    "RetryUntilSuccessful": retry,
    "RunOnce": run_once,
    "Script": script,
    "ScriptCondition": script,
    "SetBlackboard": set_blackboard,
    "Sleep": leaf("wait", "msec"),
    "AlwaysSuccess": leaf("succeed"),
    "AlwaysFailure": leaf("fail"),
}
"""Readers of the nodes, by name."""

INSTANT = {*COMPOSITES, "Inverter", "ForceSuccess", "ForceFailure", "Script", "ScriptCondition",
           "SetBlackboard", "AlwaysSuccess", "AlwaysFailure"}  # fmt: skip
"""Nodes that take no time beside their children."""


def guarded(found: Words, name: str, condition: str) -> Words:
    """Return the steps of BehaviorTree.CPP before a node that has a precondition."""
    if name == "_skipIf":
        inner = {"sequence": [found]} if "when" in found else found
        return {**inner, "when": Written(f"not ({condition})")}
    if name == "_while":
        return {"reactive_if": Written(condition), "then": found}
    end: Words = {"succeed": {}} if name == "_successIf" else {"fail": {}}
    return {"if": Written(condition), "then": end, "else": found}


def ended(found: Words, after_success: list[Words], after_failure: list[Words]) -> Words:
    """Return a node and the steps after its success and its failure in the same tick; the end is the node's own."""
    return {
        "if": found,
        "then": {"sequence": after_success} if after_success else {"succeed": {}},
        "else": {"sequence": [*after_failure, _SAME_FAILURE]} if after_failure else _SAME_FAILURE,
    }
