"""What tree files and BehaviorTree.CPP (version 4) call the same things.

Words of ours that BehaviorTree.CPP lacks become nodes whose names begin with `Pomona`; their models are in the file.
"""

from __future__ import annotations

from collections.abc import Mapping

PREFIX = "Pomona"

BRANCH_TO_XML: Mapping[str, str] = {
    "sequence": "Sequence",
    "reactive_sequence": "ReactiveSequence",
    "fallback": "Fallback",
    "reactive_fallback": "ReactiveFallback",
}
XML_TO_BRANCH: Mapping[str, str] = {xml: word for word, xml in BRANCH_TO_XML.items()} | {
    "AsyncSequence": "sequence",
    "AsyncFallback": "fallback",
}

BUILTIN = frozenset(
    [
        *XML_TO_BRANCH,
        "Parallel", "ParallelAll", "RetryUntilSuccessful", "Repeat", "Timeout", "Inverter", "ForceSuccess",
        "ForceFailure", "AlwaysSuccess", "AlwaysFailure", "Sleep", "SubTree", "SequenceWithMemory",
        "IfThenElse", "WhileDoElse", "Script", "ScriptCondition", "SetBlackboard", "UnsetBlackboard", "Delay",
        "RunOnce", "Precondition", "KeepRunningUntilFailure", "LoopInt", "LoopBool", "LoopDouble",
        "LoopString", "EntryUpdated", "SkipUnlessUpdated", "WaitValueUpdate", "TestNode", "WasEntryUpdated",
        "Switch2", "Switch3", "Switch4", "Switch5", "Switch6", "TryCatch",
    ]
)  # fmt: skip
"""Nodes that BehaviorTree.CPP has by itself."""

MODELS: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    "PomonaWhen": ("Decorator", ("condition",), "looked at once; when it does not hold the child is skipped"),
    "PomonaGuard": ("Decorator", ("condition",), "looked at before each tick; when it does not hold the node fails"),
    "PomonaForEach": ("Decorator", ("items", "item"), "the child runs once for each item"),
    "PomonaTimeout": ("Decorator", ("duration",), "the child is interrupted after a duration that is computed"),
    "PomonaRetry": ("Control", ("attempts", "retry_if"), "tries the first child; the second follows a failed try"),
    "PomonaRepeat": ("Decorator", ("rounds",), "repeats a number of times that is computed"),
    "PomonaRecovery": ("Control", ("attempts",), "the second child runs between two tries of the first"),
    "PomonaParallel": ("Control", ("success_on",), "succeeds when the named children have"),
    "PomonaCheck": ("Condition", ("condition",), "succeeds when the condition holds"),
    "PomonaWaitUntil": ("Action", ("condition",), "runs until the condition holds"),
    "PomonaWait": ("Action", ("duration",), "lets a duration pass that is computed"),
    "PomonaSet": ("Action", ("values",), "writes values"),
    "PomonaFail": ("Action", ("code", "message"), "fails with a code"),
}
"""Our own nodes: category, input ports, description."""

LITERAL = "yaml:"
"""Marks a list or mapping in an attribute: BehaviorTree.CPP would take braces for a blackboard key."""
