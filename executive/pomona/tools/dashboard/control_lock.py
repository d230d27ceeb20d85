"""Control by one operator at a time: its holder, and the actions on the run."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

from pomona.executive.errors import PomonaError
from pomona.executive.language.built import Side
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Permit, Starting
from pomona.executive.running.tick import BREAK_ACTIONS, UnknownNodeError
from pomona.executive.speed import speed_of
from pomona.tools.dashboard.messages import picture_message

ACTIONS = ("pause", "resume", "step", "stop")
CALLS = frozenset({"require", "take", "release", "acknowledge", "act", "safe_stop"})
"""Methods of `ControlLock` that pages may call."""

# answer to a safe stop during a preparation
CANCELLED = "the run that was being prepared does not begin"


class RefusedError(PomonaError):
    """An action that is not carried out, and why."""


@dataclass(frozen=True, slots=True)
class Holder:
    """The holder of control; empty without one.

    `viewer` is known to that page and the server only; `grant` counts how often control has changed hands, so that
    every page knows whether the newest grant is its own.
    """

    who: str = ""
    viewer: str = ""
    grant: int = 0


@dataclass(frozen=True, slots=True)
class ControlStatus:
    """Status of control and of the run for the pages."""

    holder: Holder = Holder()  # of control
    # the run in preparation, or the reason why the last one did not begin
    start: dict[str, Any] | None = None
    is_preparing: bool = False  # whether a run is being prepared
    known_faults: dict[str, tuple[str, ...]] = field(
        default_factory=dict
    )  # faults that can be injected into the run
    # of a run's life: its time, tick, state and the ages of its devices; None without a run
    signs: dict[str, Any] | None = None


class RunControl(Protocol):
    """Requests of the page's server to the run, which may be in another process. Methods are called from any thread."""

    @property
    def standing(self) -> ControlStatus:
        """How things stand."""

    @property
    def silent(self) -> float:
        """Time since the run's process was heard [s]; 0 in the same process."""

    def call(self, name: str, *arguments: Any) -> Any:
        """Carry out one of `CALLS`, a method of `ControlLock`. Raises RefusedError: it is not carried out."""

    def safe_stop(self, who: str) -> str:
        """See `ControlLock`."""


class ControlLock:
    """One operator at a time acts; anybody may safe-stop. Methods may be called from any thread."""

    def __init__(
        self, changed: Callable[[], None] = lambda: None, permit: Permit | None = None
    ) -> None:
        """
        Args:
            changed: called after each change.
            permit: needed by each run to begin; see `Starting`.
        """
        self._permit = permit
        self._lock = threading.Lock()
        self._held = Holder()
        self._runner: Runner | None = None
        self._starting: tuple[str, Starting] | None = None
        self._problem: dict[str, Any] | None = None
        self._changed = changed
        self._shown: dict[str, int] = {}
        self._breaks: dict[
            tuple[str, Side], None
        ] = {}  # breakpoints, which the next run gets as well

    silent = 0.0

    def call(self, name: str, *arguments: Any) -> Any:
        """See `RunControl`. Raises RefusedError: the page has no such call."""
        if name not in CALLS:
            raise RefusedError(f"'{name}' is no call of the page")
        return getattr(self, name)(*arguments)

    @property
    def standing(self) -> ControlStatus:
        """How things stand, for the page."""
        return ControlStatus(
            self._held, self.start, self.is_preparing, self.known_faults, self._signs()
        )

    def pictures(self) -> list[dict[str, Any]]:
        """Fields of a `Picture` for each camera of the run in progress that has a new image at no cost."""
        runner = self._runner
        if runner is None or runner.state.ended:
            return []
        shown = {device: id(image) for device, (image, _age) in runner.pictures.items()}
        new = [device for device, image in shown.items() if self._shown.get(device) != image]
        self._shown = shown
        return [
            picture_message(device, *picture)
            for device, picture in runner.pictures.items()
            if device in new
        ]

    def _signs(self) -> dict[str, Any] | None:
        runner = self._runner
        if runner is None:
            return None
        t, tick = runner.progress
        ages = {device: round(age, 3) for device, age in runner.ages.items()}
        return {
            "t": t,
            "tick": tick,
            "wall": round(runner.wall, 2),
            "state": runner.state.value,
            "ages": ages,
        }

    @property
    def holder(self) -> Holder:
        """Who has control of the run now."""
        return self._held

    @property
    def runner(self) -> Runner | None:
        """The run in progress, or None."""
        return self._runner

    @property
    def start(self) -> dict[str, Any] | None:
        """The run in preparation, or the reason why the last one did not begin, for the page."""
        if self._starting is None:
            return self._problem
        tree, starting = self._starting
        stage = starting.stage
        if stage is None:
            return None
        return {
            "tree": tree,
            "cell_kind": starting.cell_kind,
            "what": stage.what,
            "done": stage.done,
            "of": stage.of,
            "age": round(starting.age, 3),
            "cancelled": starting.cancelled,
        }

    @property
    def known_faults(self) -> dict[str, tuple[str, ...]]:
        """Faults that can be injected into the run, with their modes; nothing without a run, and on a real cell."""
        runner = self._runner
        return {} if runner is None or runner.state.ended else runner.known_faults

    @property
    def is_preparing(self) -> bool:
        """Whether a run is being prepared."""
        return self._starting is not None and self._starting[1].stage is not None

    @property
    def is_busy(self) -> bool:
        """Whether a run is being prepared, goes on, or holds a latched safe state."""
        runner = self._runner
        return self.is_preparing or (
            runner is not None and (not runner.state.ended or runner.latched is not None)
        )

    def prepare(self, tree: str) -> Starting:
        """Note the preparation of a run of this tree; `execute` reports to the result until `serve`."""
        starting = Starting(self._changed, self._permit)
        self._starting = (tree, starting)
        self._problem = None
        self._changed()
        return starting

    def clear(self, problem: str = "") -> None:
        """Note that nothing runs or is in preparation any more; `problem` is the reason why a run did not begin."""
        if self._starting is not None and problem:
            self._problem = {"tree": self._starting[0], "problem": problem}
        self._starting = None
        self.serve(None)

    def serve(self, runner: Runner | None) -> None:
        """Act on this runner from now on."""
        self._runner = runner
        if runner is not None and self._held.who:
            runner.note(self._held.who, "take")  # the record begins with who holds control
            for path, side in self._breaks:
                with suppress(UnknownNodeError):  # another tree
                    runner.break_at(path, side, who=self._held.who)
        self._changed()

    def take(self, viewer: str, who: str) -> None:
        """Take control, visibly, also from another operator. Raises RefusedError: the viewer has no name."""
        if not viewer:
            raise RefusedError("the id of the viewer is missing")
        self._hand_over(viewer, Holder(who, viewer), who, "take")

    def release(self, viewer: str) -> None:
        """Give control back; harmless for a viewer that does not hold it."""
        held = self._held
        if viewer and held.viewer == viewer:
            self._hand_over(viewer, Holder(), held.who, "release")

    def _hand_over(self, viewer: str, to: Holder, who: str, action: str) -> None:
        with self._lock:
            if action == "release" and self._held.viewer != viewer:
                return
            self._held = Holder(to.who, to.viewer, self._held.grant + 1)
        if self._runner is not None:
            self._runner.note(who, action)
        self._changed()

    def require(self, viewer: str) -> str:
        """Return the name of the operator who holds control with this viewer.

        Raises RefusedError: another operator does, or none.
        """
        held = self._held
        if not viewer or held.viewer != viewer:
            raise RefusedError(f"{held.who or 'no operator'} holds control; take it first")
        return held.who

    def cancel_start(self, viewer: str) -> bool:
        """Let the run that is being prepared not begin; False when none is.

        Raises RefusedError: the viewer does not hold control.
        """
        who = self.require(viewer)
        starting = self._starting
        if starting is None or starting[1].stage is None:
            return False
        starting[1].cancel(f"cancelled by {who}", who)
        return True

    def safe_stop(self, who: str) -> str:
        """Stop now. This needs no control; a run in preparation does not begin.

        Returns:
            the confirmation: the cell is in its safe state when this returns.

        Raises RefusedError: the cell did not take it.
        """
        because = f"safe stop by {who}"
        starting = self._starting
        runner = self._runner
        if starting is not None and starting[1].stage is not None:
            starting[1].cancel(because, who)
            return CANCELLED
        if runner is None or (runner.state.ended and runner.latched is None):
            if starting is not None:  # a recovery has just ended, and the run would begin after it
                starting[1].cancel(because, who)
                return "nothing was running, and nothing begins now"
            return "nothing was running"
        runner.safe_stop(because, who)
        if runner.latched is None:
            raise RefusedError("the cell did not take the safe stop: use the emergency stop")
        return f"safe state: {runner.latched}"

    def acknowledge(self, viewer: str) -> None:
        """Release the latch of the safe state. Nothing resumes by itself.

        Raises RefusedError: the viewer does not hold control, or nothing is latched, or the run has not ended yet.
        """
        who = self.require(viewer)
        if self._runner is None or self._runner.latched is None:
            raise RefusedError("no safe state is latched")
        if not self._runner.state.ended:
            raise RefusedError("the cell is still coming to rest")
        self._runner.acknowledge(who)

    def act(self, viewer: str, action: str, detail: str = "", number: int = 0) -> None:
        """Pass an action to the runner.

        Args:
            viewer: id of the page or program that acts.
            action, detail: as `OperatorActed` has them.
            number: of the question that `answer` answers, or of the pause that `resume` and `step` end and in
                which `reload` acts.

        Raises RefusedError: the viewer does not hold control, nothing runs, there is no such action or node, or the
        question or pause of this number is not open.
        """
        who = self.require(viewer)
        if action not in (*ACTIONS, *BREAK_ACTIONS, "answer", "fail", "change", "reload", "speed"):
            raise RefusedError(f"unknown action '{action}'")
        latched = action == "fail" and self._runner is not None and self._runner.latched is not None
        if self._runner is None or (
            self._runner.state.ended and not latched
        ):  # a broken device may be repaired
            raise RefusedError("nothing is running")
        try:
            self._carry_out(self._runner, who, action, detail, number)
        except PomonaError as error:  # of a changed tree file as well
            raise RefusedError(str(error)) from None

    def _carry_out(self, runner: Runner, who: str, action: str, detail: str, number: int) -> None:
        if action == "answer":
            choice, _, path = detail.rpartition(" ← ")
            runner.answer(path, number, choice, who)
        elif action == "resume":
            runner.resume(number, who)
        elif action == "step":
            runner.step(number, who)
        elif action == "change":
            said, _, path = detail.rpartition(" ← ")
            port, _, value = said.partition("=")
            runner.change(path, port.strip(), value.strip(), who)
        elif action == "reload":
            runner.reload(number, who)
        elif action == "speed":
            runner.set_speed(speed_of(detail), who)
        elif action == "fail":
            switch, _, kind = detail.partition(" ")
            runner.fail(switch, kind, who)
        elif action in BREAK_ACTIONS:
            side, on = BREAK_ACTIONS[action]
            runner.break_at(detail, side, on, who)
            self._breaks.pop((detail, side), None)
            self._breaks |= {(detail, side): None} if on else {}
        else:
            getattr(runner, action)(who)
