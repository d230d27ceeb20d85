"""Names of BehaviorTree.CPP (version 4), and the names that trees and nodes get in a tree file."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable

from pomona.executive.language.read_node import is_word
from pomona.executive.nodes.catalogue import NodeTypes

PREFIX = "Pomona"  # begins the names of words that BehaviorTree.CPP lacks, in an export

# begins a list or mapping in an attribute: braces alone would be a blackboard key
LITERAL = "yaml:"

GENERIC = ("Action", "Condition", "Control", "Decorator")
"""Elements whose attribute `ID` is the name of the node."""

COMPOSITES = {
    "Sequence": "sequence", "AsyncSequence": "sequence", "ReactiveSequence": "reactive_sequence",
    "SequenceWithMemory": "sequence_with_memory", "Fallback": "fallback", "AsyncFallback": "fallback",
    "ReactiveFallback": "reactive_fallback",
}  # fmt: skip
"""Composites that tree files have under another name."""

NO_SKILLS = frozenset(
    [
        "ParallelAll", "TryCatch", "ManualSelector", "ConsumeQueue", "LoopInt", "LoopBool", "LoopDouble",
        "LoopString", "UnsetBlackboard", "WasEntryUpdated", "EntryUpdated", "SkipUnlessUpdated", "WaitValueUpdate",
        "TestNode", "SubTreePlus", "SequenceStar", "FallbackStar", "RetryUntilSuccesful", "BlackboardCheckInt",
        "BlackboardCheckDouble", "BlackboardCheckString", "BlackboardCheckBool", "RecoveryNode", "PipelineSequence",
        "RoundRobin", "RateController", "DistanceController", "SpeedController",
    ]
)  # fmt: skip
"""Nodes of BehaviorTree.CPP 4 and 3, and control nodes of Nav2, that tree files lack."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def tree_names(trees: Iterable[str], types: NodeTypes) -> dict[str, str]:
    """Return the names of trees, by ID: different from each other and from the words of the language."""
    found: dict[str, str] = {}
    for tree_id in trees:
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", in_ascii(tree_id))
        start = re.sub(r"[^a-z0-9_]", "_", words.lower()).strip("_")
        start = start if _NAME.fullmatch(start) else f"tree_{start}".rstrip("_")
        found[tree_id] = free_name(
            start, lambda name: name in found.values() or is_word(types, name), "_"
        )
    return found


def free_name(start: str, is_taken: Callable[[str], bool], sign: str) -> str:
    """Return a name that is not taken: with a number behind a sign, if it must be."""
    name = start
    number = 1
    while is_taken(name):
        number += 1
        name = f"{start}{sign}{number}"
    return name


def node_name(name: str) -> str:
    """Return the name of a node."""
    return re.sub(r"[/:#{}\x00-\x1f]", " ", name).strip()[:80] or "node"


def in_ascii(name: str) -> str:
    """Return a name without accents, and without letters that ASCII has no likeness of."""
    plain = unicodedata.normalize("NFKD", name.replace("ß", "ss"))
    return plain.encode("ascii", "ignore").decode()


def skill_name(node_id: str) -> str:
    """Return the most similar name that a skill can have."""
    words = re.findall(r"[A-Za-z0-9]+", in_ascii(node_id))
    return "".join(word[0].upper() + word[1:] for word in words).lstrip("0123456789") or "Skill"
