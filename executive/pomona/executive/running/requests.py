"""Requests to a run, from any thread, carried out between two ticks. `safe_stop` alone acts at once."""

from __future__ import annotations

import queue
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pomona.executive.cell.cell import Cell
from pomona.executive.errors import PomonaError
from pomona.executive.language.built import BuiltTree, Side
from pomona.executive.language.changes import changed_input
from pomona.executive.nodes.ask import Question
from pomona.executive.running.tick import BREAK_ACTIONS, Breakpoints
from pomona.executive.speed import SpeedRefusedError, cannot_slow, checked_speed

LATE = 2.0  # age on the wall clock from which a request that starts motion is rejected as unexpected [s]

SETS_IN_MOTION = ("resume", "step", "answer")
"""Actions that are carried out within `LATE` and for the pause or question that they name, or not at all."""


class AnswerRefusedError(PomonaError):
    """An answer that names no open question, a resume that names no current pause, or an unknown choice."""


class Request(NamedTuple):
    """One request to the run."""

    action: str  # action, who, detail: as `OperatorActed` has them
    who: str
    detail: str
    number: int  # of the question that it answers or the pause that it ends; 0 for any other action
    at: float  # monotonic time of the request [s]


class UnknownFaultError(PomonaError):
    """The cell cannot be made to fail so."""

    def __init__(self, fault: str, known: Mapping[str, Sequence[str]]) -> None:
        self.fault = fault
        self.known = known
        super().__init__(
            f"this cell has no fault '{fault}'; there are {', '.join(known)}"
            if known
            else "faults cannot be made here"
        )


class Requests:
    """The part of a run that operators, dashboards and signals reach."""

    _cell: Cell
    _breakpoints: Breakpoints
    tree: BuiltTree
    questions: Mapping[str, Question]
    pause_number = 0
    """Number of the pause that has begun and not ended, 0 without one. `resume` and `step` name it. From any thread."""

    def __init__(self) -> None:
        self._commands: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._speeds: queue.SimpleQueue[tuple[float, str, float]] = queue.SimpleQueue()
        self._leaving = False
        self.breakable = False
        """Whether the run survives an exception that a signal's handler raises in the tick thread now."""

    def pause(self, who: str = "operator") -> None:
        """Stop motions on their paths and hold; force control goes on."""
        self._ask("pause", who, "")

    def resume(self, number: int, who: str = "operator") -> None:
        """End pause `number` and go on in place, after checking that the world is as it was.

        Raises AnswerRefusedError: the run is not in this pause.
        """
        self._refuse_other_pause(number)
        self._ask("resume", who, "", number)

    def step(self, number: int, who: str = "operator") -> None:
        """End pause `number`, run one tick, then pause again.

        Raises AnswerRefusedError: the run is not in this pause.
        """
        self._refuse_other_pause(number)
        self._ask("step", who, "", number)

    def stop(self, who: str = "operator") -> None:
        """Halt every running skill, wait until each has halted, end the run."""
        self._ask("stop", who, "")

    def safe_stop(self, reason: str, who: str = "operator") -> None:
        """Bring the cell into its safe state now, in any phase of the tick, and end the run."""
        self._cell.safe_stop(reason)
        self._ask("safe_stop", who, reason)

    def interrupt(
        self, who: str = "keyboard", reason: str = "interrupted from the keyboard"
    ) -> None:
        """Request the safe state now, and the run's end, after a signal. Do not call it in the signal's handler itself:
        the interrupted tick may hold the cell's lock.
        """
        self._ask("interrupt", who, reason)
        self._cell.safe_stop(reason)

    def break_at(
        self, path: str, side: Side = "before", on: bool = True, who: str = "operator"
    ) -> None:
        """Pause before the node at this path starts, or after it has ended; `on=False` takes the breakpoint away.

        Raises UnknownNodeError: the tree has no such node.
        """
        self._breakpoints.check(path)
        action = next(action for action, change in BREAK_ACTIONS.items() if change == (side, on))
        self._ask(action, who, path)

    def answer(self, path: str, number: int, choice: str, who: str = "operator") -> None:
        """Answer question `number` of the node at this path (`NodeChanged.starts`).

        Raises AnswerRefusedError: this question is not open, or this is no choice.
        """
        asked = self.questions.get(path)
        if asked is None or not asked.open:
            raise AnswerRefusedError(f"no question is open at {path}")
        if number != asked.starts:
            raise AnswerRefusedError(
                f"{path} now asks question {asked.starts}; the answer names question {number}"
            )
        if choice not in asked.choices:
            raise AnswerRefusedError(f"'{choice}' is no answer: {', '.join(asked.choices)}")
        self._ask("answer", who, f"{choice} ← {path}", number)

    def change(self, path: str, port: str, text: str, who: str = "operator") -> None:
        """Give an input of the skill at this path another value, as in a tree file, from its next start on.

        Raises ChangeRefusedError: there is no such skill or input, or this is no value for it.
        """
        changed_input(self.tree, path, port, text)
        self._ask("change", who, f"{port} = {text} ← {path}")

    def set_speed(self, share: float, who: str = "operator") -> None:
        """Scale the arm's commanded speed by this ratio from now on, also on a path in progress.

        Raises SpeedRefusedError: it is not from 10 % to 100 %, or the cell cannot be slowed down.
        """
        speed = checked_speed(share)
        if speed < 1.0 and self._cell.full_speed_only:
            raise SpeedRefusedError(cannot_slow(self._cell.full_speed_only))
        self._speeds.put((speed, who, time.monotonic()))

    @property
    def known_faults(self) -> dict[str, tuple[str, ...]]:
        """Return the faults that can be injected, with their modes; nothing on a real cell."""
        return {name: tuple(switch.known_faults) for name, switch in self._cell.switches.items()}

    def fail(self, switch: str, kind: str, who: str = "operator") -> None:
        """Let something of a simulated or emulated cell fail, or with no kind work again.

        Raises UnknownFaultError: there is no such switch, or it knows no such fault.
        """
        known = self.known_faults
        if switch not in known or (kind and kind not in known[switch]):
            raise UnknownFaultError(f"{switch} {kind}".strip(), known)
        self._ask("fail", who, f"{switch} {kind}".strip())

    def note(self, who: str, action: str) -> None:
        """Record that an operator took or released control: it changes nothing in the run."""
        self._ask(action, who, "")

    def acknowledge(self, who: str = "operator") -> None:
        """Release the latch of the safe state, once the run has ended; `hold_latched` waits for this."""
        self._ask("acknowledge", who, "")

    def leave(self) -> None:
        """Make `hold_latched` return without an acknowledgement: the process ends."""
        self._leaving = True
        self._ask("leave", "", "")

    def _ask(self, action: str, who: str, detail: str, number: int = 0) -> None:
        self._commands.put(Request(action, who, detail, number, time.monotonic()))

    def _refuse_other_pause(self, number: int) -> None:
        if not self.pause_number:
            raise AnswerRefusedError("the run is not paused")
        if number != self.pause_number:
            raise AnswerRefusedError(
                f"the run is in pause {self.pause_number}; the request names pause {number}"
            )

    @property
    def latched(self) -> str | None:
        """The reason of the cell's safe state, while it is latched."""
        return self._cell.latched
