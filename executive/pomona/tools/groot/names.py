"""Words of BehaviorTree.CPP (version 4) that no skill can have as a name, and nodes for Pomona's own words.

Words of Pomona that BehaviorTree.CPP lacks become nodes whose names begin with `Pomona`; the file holds their models.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

from pomona.executive.language.read_node import is_word
from pomona.executive.nodes.catalogue import NodeTypes

PREFIX = "Pomona"
_NAME = re.compile(r"[a-z][a-z0-9_]*")

BUILTIN = frozenset(
    [
        "Sequence", "AsyncSequence", "ReactiveSequence", "SequenceWithMemory", "Fallback", "AsyncFallback",
        "ReactiveFallback", "Parallel", "ParallelAll", "RetryUntilSuccessful", "Repeat", "Timeout", "Inverter",
        "ForceSuccess", "ForceFailure", "AlwaysSuccess", "AlwaysFailure", "Sleep", "SubTree", "IfThenElse",
        "WhileDoElse", "Script", "ScriptCondition", "SetBlackboard", "UnsetBlackboard", "Delay", "RunOnce",
        "Precondition", "KeepRunningUntilFailure", "LoopInt", "LoopBool", "LoopDouble", "LoopString", "EntryUpdated",
        "SkipUnlessUpdated", "WaitValueUpdate", "TestNode", "WasEntryUpdated", "Switch2", "Switch3", "Switch4",
        "Switch5", "Switch6", "TryCatch", "ManualSelector", "ConsumeQueue", "SubTreePlus", "BlackboardCheckInt",
        "BlackboardCheckDouble", "BlackboardCheckString", "BlackboardCheckBool",
    ]
)  # fmt: skip
"""Nodes that BehaviorTree.CPP has by itself, the last five in version 3."""

NEEDED = {
    "Timeout": "msec", "Delay": "delay_msec", "Sleep": "msec", "Repeat": "num_cycles",
    "RetryUntilSuccessful": "num_attempts",
}  # fmt: skip
"""An attribute without which a node of BehaviorTree.CPP does not run, by its name."""

LITERAL = "yaml:"  # marks a list or mapping in an attribute: BehaviorTree.CPP would take braces for a blackboard key


def tree_names(trees: Iterable[str], types: NodeTypes) -> dict[str, str]:
    """Return the names of trees, by ID: different from each other and from the words of the language."""
    found: dict[str, str] = {}
    for tree_id in trees:
        start = name = _tree_name(tree_id)
        number = 1
        while name in found.values() or is_word(types, name):
            number += 1
            name = f"{start}_{number}"
        found[tree_id] = name
    return found


def node_name(name: str) -> str:
    """Return the name of a node."""
    return re.sub(r"[/:#{}\x00-\x1f]", " ", name).strip()[:80] or "node"


def in_ascii(name: str) -> str:
    """Return a name without accents, and without letters that ASCII has no likeness of."""
    plain = (
        unicodedata.normalize("NFKD", name.replace("ß", "ss")).encode("ascii", "ignore").decode()
    )
    return plain if plain.strip(" _") else ""


def skill_name(node_id: str) -> str:
    """Return the most similar name that a skill can have."""
    words = re.findall(r"[A-Za-z0-9_]+", in_ascii(node_id))
    return "".join(word[0].upper() + word[1:] for word in words).lstrip("0123456789_") or "Skill"


def _tree_name(tree_id: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", in_ascii(tree_id))
    name = re.sub(r"[^a-z0-9_]", "_", words.lower()).strip("_")
    return name if _NAME.fullmatch(name) else f"tree_{name}".rstrip("_")
