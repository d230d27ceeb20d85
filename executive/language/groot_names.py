"""Words of BehaviorTree.CPP (version 4) that no skill can have, and how we write what it has no words for.

Words of ours that BehaviorTree.CPP lacks become nodes whose names begin with `Pomona`; their models are in the file.
"""

from __future__ import annotations

PREFIX = "Pomona"

BUILTIN = frozenset(
    [
        "Sequence", "AsyncSequence", "ReactiveSequence", "SequenceWithMemory", "Fallback", "AsyncFallback",
        "ReactiveFallback", "Parallel", "ParallelAll", "RetryUntilSuccessful", "Repeat", "Timeout", "Inverter",
        "ForceSuccess", "ForceFailure", "AlwaysSuccess", "AlwaysFailure", "Sleep", "SubTree", "IfThenElse",
        "WhileDoElse", "Script", "ScriptCondition", "SetBlackboard", "UnsetBlackboard", "Delay", "RunOnce",
        "Precondition", "KeepRunningUntilFailure", "LoopInt", "LoopBool", "LoopDouble", "LoopString", "EntryUpdated",
        "SkipUnlessUpdated", "WaitValueUpdate", "TestNode", "WasEntryUpdated", "Switch2", "Switch3", "Switch4",
        "Switch5", "Switch6", "TryCatch", "ManualSelector", "ConsumeQueue",
    ]
)  # fmt: skip
"""Nodes that BehaviorTree.CPP has by itself."""

NEEDED = {
    "Timeout": "msec", "Delay": "delay_msec", "Sleep": "msec", "Repeat": "num_cycles",
    "RetryUntilSuccessful": "num_attempts",
}  # fmt: skip
"""An attribute without which a node of BehaviorTree.CPP does not run, by its name."""

LITERAL = "yaml:"
"""Marks a list or mapping in an attribute: BehaviorTree.CPP would take braces for a blackboard key."""
