"""Account of a task: its success as the robot's own devices measured it, what it lacks, and how hard fruit was pressed.

A tree declares its success with a word of `SUCCESSES`. Skills publish an `AccountEntry` for each measurement. The truth
of a simulated world is no part of it: `disagreement` compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.reasons import Reason

HELD = "held"
PUT_AWAY = "put_away"
NOTHING_LEFT = "nothing_left"
HELD_FRUIT = "the held fruit"  # what it lacks, until it is put away
SUCCESSES = {
    HELD: "the hand holds a fruit at the end",
    PUT_AWAY: "each fruit that was found lies where it belongs",
}
"""Words for `success:` of a tree."""


@dataclass(frozen=True, slots=True)
class AccountEntry:
    """One measurement.

    Attributes:
        about: a word of `SUCCESSES` or `NOTHING_LEFT`, for which this is evidence; else what the task lacks.
        words: the measured values with their source; empty: it lacks that no more.
        press: force on a fruit over the one that bruises it, by `about`; beyond 1 the task lacks a sound fruit.
    """

    about: str
    words: str
    press: float = 0.0


@dataclass(slots=True)
class Account:
    """All entries of a run.

    Attributes:
        success: word that the tree declares; empty: its end is its success, or nothing measures.
        bruises: number of presses beyond the limit.
    """

    success: str = ""
    evidence: dict[str, list[str]] = field(default_factory=dict)
    lacking: dict[str, str] = field(default_factory=dict)
    press: float = 0.0
    pressed: str = ""
    bruises: int = 0

    def add(self, entry: AccountEntry, node: str = "") -> None:
        """Take an entry of a node; of presses the largest."""
        self.bruises += entry.press > 1.0
        if entry.press > self.press:
            self.press = entry.press
            self.pressed = f"{node.rpartition('/')[2]}: {entry.words}"
        elif entry.about in (*SUCCESSES, NOTHING_LEFT):
            found = self.evidence.setdefault(entry.about, [])
            found.append(entry.words)
            if entry.about == PUT_AWAY:  # what this fruit lacks stays, whatever the next one shows
                self.lacking[f"{HELD_FRUIT} {len(found)}"] = self.lacking.pop(HELD_FRUIT, "")
        elif not entry.press:
            self.lacking[entry.about] = entry.words

    @property
    def verified(self) -> float:
        """How often the success was measured; nan without a word for it."""
        return len(self.evidence.get(self.success, ())) if self.success else float("nan")

    def doubt(self, in_hand: str | None) -> Reason | None:
        """Return why a tree that succeeded has not done its task, or not all of it; None: it has.

        Args:
            in_hand: description of a held object; None in a cell without a hand.
        """
        success = self.success
        lacking = [words for words in self.lacking.values() if words]
        if self.press > 1.0:
            lacking.append(self.pressed)
        if success == HELD and in_hand == "":
            lacking.append("the hand is empty at the end")
        if lacking:
            return Reason("", "DONE_IN_PART", "; ".join(lacking))
        of_it = self.evidence.get(success) or (
            success == PUT_AWAY and NOTHING_LEFT in self.evidence
        )
        if success and not of_it:
            words = f"no device of the cell has measured that {SUCCESSES[success]}"
            return Reason("", "UNVERIFIED", words)
        return None

    def report(self) -> Mapping[str, Any]:
        """Return plain values: the success with its newest evidence, how many there are, the largest press."""
        found = self.evidence.get(self.success) or self.evidence.get(NOTHING_LEFT, [])
        return {
            "success": self.success,
            "count": self.verified if self.success else 0,
            "evidence": found[-1] if self.success and found else "",
            "press": self.press,
            "pressed": self.pressed,
        }


def disagreement(outcome: str | None, account: Any, truth: Any) -> str:
    """Return how a simulated world's truth contradicts the robot's own result; empty where it does not, or is unknown.

    Args:
        outcome: of the run.
        account: of `Account.report`, as plain values.
        truth: the world's score, as plain values.
    """
    if not isinstance(account, Mapping) or not isinstance(truth, Mapping):
        return ""
    success = account.get("success")
    if success == HELD and "lifted" in truth:
        claimed, true = int(outcome == "success"), int(bool(truth["lifted"]))
    elif success == PUT_AWAY and "put_away" in truth:
        claimed, true = account.get("count", 0), truth["put_away"]
    else:
        return ""
    words = f"{claimed} {success.replace('_', ' ')} as measured, {true} in truth"
    if claimed != true:
        return f"{'FALSE_SUCCESS' if claimed > true else 'FALSE_FAILURE'}: {words}"
    bruised = truth.get("bruised") if outcome == "success" else 0
    return f"FALSE_SUCCESS: {bruised} bruised, {truth.get('pressed')}" if bruised else ""
