"""Base of skills: typed ports, a body that is polled, and failure with a reason.

A skill is a py_trees behaviour whose body is one generator, `run`. Each `yield` hands the tick back (RUNNING, with an
optional line of feedback); `return` is success with outputs; `raise self.failure(CODE, sentence, **data)` is failure.
When the tree interrupts it, `Interrupted` is raised at the `yield`: the body stops its motions, may yield while that
takes time, and lets the exception pass. Work that takes longer than a moment goes through `self.compute`.

    class Refined(Outputs):
        measured: MeasuredFruit

    class Refine(Skill):
        failures = ("NO_DEPTH", "TOO_FEW_INLIERS")

        def run(self, detection: Detection, inlier_band: Length = LENGTH("4 mm")) -> Work[Refined]:
            fit = yield from self.compute(refine, detection.frame.depth, ...)
            return Refined(measured=fit)

Its ports are declared once: the parameters of `run` are the inputs, the fields of its result the outputs
(`pomona.executive.signature`). A mistake in them is an error when the class is made.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import math
import os
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from inspect import isgeneratorfunction
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, cast

import py_trees
from py_trees.common import Status

from pomona.executive.account import AccountEntry
from pomona.executive.clock import Clock
from pomona.executive.errors import SkillError
from pomona.executive.lease import BLOCKED, notice_of
from pomona.executive.ports import Outputs, Ports
from pomona.executive.signature import ports_of
from pomona.executive.values.findings import Located
from pomona.executive.values.processes import write_if_read
from pomona.executive.values.sections import Problem
from pomona.executive.values.sentences import shortened

if TYPE_CHECKING:
    import numpy as np

POLLED: ContextVar[str] = ContextVar("POLLED", default="")
"""Path of the skill whose body runs now, also in the threads that compute for it; empty outside."""

T = TypeVar("T")
Work = Generator["str | None", None, T]
"""Result of a `run` that takes several ticks: it yields lines of feedback and returns its outputs."""


# A skill or a library may fork. A child that comes back into the run (`sys.exit` in it, or no end at all) would stop
# and close the devices that it shares with its parent, and dismiss the parent's supervisor: it leaves at once instead.
CHILD = 3  # exit status of a child that came back into the run

_process: int | None = None  # process of the run in progress here, or in the parent of this copy


def leave_if_forked() -> None:
    """End a child of the run's process; called wherever foreign code comes back into the run."""
    if _process is not None and os.getpid() != _process:
        write_if_read(2, b"a process that was forked in the run came back into it, and was ended\n")
        os._exit(CHILD)


def continue_here() -> None:
    """Go on with the run in this copy of its process, on purpose: it is another run from here on."""
    global _process
    _process = os.getpid()


@contextlib.contextmanager
def run_in_progress() -> Iterator[None]:
    """From the connecting of a cell to its closing, in the thread of the tick."""
    global _process
    before = _process
    _process = os.getpid()
    gc.disable()  # a full collection holds up each thread for 0.15 s: too long for the beats of an arm
    try:
        yield
    finally:
        leave_if_forked()
        _process = before
        gc.unfreeze()
        gc.enable()


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a skill failed: a code from its closed set, a sentence for a person, and data (JSON-like values)."""

    code: str
    message: str
    data: Mapping[str, object] = field(default_factory=dict)


class SkillFailure(Exception):
    """Raised by a skill's body to fail with a reason; made by `Skill.failure`."""

    def __init__(self, failure: Failure) -> None:
        self.failure = failure
        super().__init__(f"{failure.code}: {failure.message}")


class Interrupted(BaseException):
    """Raised into a skill's body when the tree interrupts it. Never swallow it."""


class Computation(Protocol):
    """Work that goes on beside the tick."""

    def done(self) -> bool:
        """Return True if it has ended."""

    def result(self) -> Any:
        """Return the function's result, or the exception that it raised."""

    def cancel(self) -> None:
        """Give up at once; an isolated computation's process is killed."""


class CellFacts(Protocol):
    """Facts about a cell before it is connected."""

    @property
    def name(self) -> str: ...

    def known(self, what: type[T]) -> T | None:
        """Return an object that its file describes (`pomona.drivers.interfaces.Workspace`), or None."""

    def place(self, interface: type) -> Located | None:
        """Return where its file describes the device with this interface, or None where it has none."""


class SkillContext(Protocol):
    """Services of a run for its skills."""

    @property
    def clock(self) -> Clock:
        """The cell's clock."""

    @property
    def lacking(self) -> tuple[Any, ...]:
        """How often the task's success was measured so far (nan: it declares none), then what it lacks: number of presses
        beyond a fruit's limit, and words.
        """

    def device(self, interface: type[T], skill: Skill) -> T:
        """Return the skill's handle of the cell's device with this interface; commands need an acquired device.

        Raises KeyError: the cell has none.
        """

    def seed(self, node: str) -> int:
        """Return a seed for one start of a node: equal in all runs with the run's seed, different between starts."""

    def compute(
        self, node: str, function: Callable[..., Any], *arguments: Any, isolated: bool
    ) -> Computation:
        """Start a function beside the tick: see `Skill.compute`."""

    def publish(self, node: str, topic: str, value: object) -> None:
        """Show a value to everyone who watches the run, and record it."""

    def pause(self, why: str) -> bool:
        """Pause the run after this tick, until an operator resumes it; False, and no pause, without an operator."""

    def elapsed(self) -> float:
        """Return the run's time [s], which stands still during a pause. Deadlines of the tree use it."""

    def acquire(self, skill: Skill) -> str | None:
        """Make a skill the owner of the devices that it moves, or return the reason to wait and acquire nothing."""

    def release(self, skill: Skill) -> None:
        """The skill moves nothing any more. Harmless when it owns nothing."""

    def halt(self, skill: Skill, work: Work[Any]) -> None:
        """Drive an interrupted body until it has ended; the skill owns its devices until then. Never raises."""


class SkillLogger(logging.LoggerAdapter[logging.Logger]):
    """The logger of a skill, from INFO on."""

    def debug(self, *_: object, **__: object) -> None:
        """Drop a line: py_trees writes one at each stop, which must not wait for the lock of `logging`."""


class Skill(py_trees.behaviour.Behaviour):
    """A leaf of the tree. Subclasses declare their devices and failure codes, and write `run`.

    `run` is the skill's body: a generator function, or for instant work a function that returns the outputs.

    Attributes:
        inputs, outputs: ports, read from the signature of `run`; only a class with `run(self, **inputs)` (a mock)
            declares them itself.
        devices: interfaces of the cell's devices that it needs.
        optional_devices: interfaces of devices that it uses where the cell has them.
        failures: codes with which it can fail.
        renamed_failures: codes of the previous version, each with its present name; the checker reports trees that
            still use the old one.
    """

    inputs: ClassVar[Ports] = Ports()
    outputs: ClassVar[Ports] = Ports()
    devices: ClassVar[tuple[type, ...]] = ()
    optional_devices: ClassVar[tuple[type, ...]] = ()
    moves: ClassVar[tuple[type, ...] | None] = None
    """Those of its devices that it moves, of which it must be the only owner; the others it only looks at. By default
    all of them, or none for instant work."""
    failures: ClassVar[tuple[str, ...]] = ()
    renamed_failures: ClassVar[Mapping[str, str]] = {}
    measures: ClassVar[bool] = False
    """Whether it measures a success (`account.SUCCESSES`): a tree with it is to declare which one is its own."""
    own_speed: ClassVar[bool] = False
    """Whether its motions keep their own speed, independent of the operator's and the tree's: its measurement depends
    on the speed."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "run" in vars(cls):
            ports = ports_of(cls.__name__, vars(cls)["run"])
            if ports is not None:
                said = {"inputs", "outputs"} & vars(cls).keys()
                if said:
                    raise SkillError(
                        cls.__name__,
                        f"{', '.join(sorted(said))} are declared by the signature of run already",
                    )
                cls.inputs, cls.outputs = ports

    def __init__(self, name: str = "") -> None:
        super().__init__(name or type(self).__name__)
        self.logger: Any = SkillLogger(logging.getLogger(type(self).__module__), {})
        self.reason: Failure | None = None
        self.path = self.name
        self.starts = 0
        self.blocked = 0.0  # seconds that the last poll kept the tick waiting
        self.broke = False  # whether it raised an exception other than a failure: this ends the run
        self.changed: dict[str, object] = {}
        """Inputs that were changed while the tree runs; they apply from the next start on."""
        self.slowed_by: list[Callable[[], float]] = []
        """Shares of the speed that the tree gives it, as they are now."""
        self.pace = 1.0
        self._work: Work[Any] | None = None
        self._context: SkillContext | None = None
        self._read: Callable[[], Mapping[str, object]] = dict
        self._write: Callable[[str, object], None] = lambda _name, _value: None

    @classmethod
    def claims(cls) -> tuple[type, ...]:
        """Return devices that it moves; no other skill may move them from its start until it has ended or halted."""
        if cls.moves is not None:
            return cls.moves
        return cls.devices if isgeneratorfunction(getattr(cls, "run", None)) else ()

    def speed(self, allowed: float) -> float:
        """Return the share of the speed at which it moves its devices from now on, where the operator allows a share."""
        self.pace = 1.0 if self.own_speed else allowed * math.prod(s() for s in self.slowed_by)
        return self.pace

    # ------------------------------------------------------------------------------------- for subclasses

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterable[Problem]:
        """Yield the problems of a use of this skill, before any connection.

        Args:
            known: inputs whose value is the same in every run, in SI, by their ports.
            cell: facts about the cell, or None when a tree is checked alone.
        """
        return ()

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> Iterable[str]:
        """Return suggestions for a port, for editors; `judge` reports wrong values."""
        return ()

    def known(self, port: str) -> Any:
        """Return an input's value before the run begins, for `prepare`; None if it is only known in the run."""
        try:
            return self._read().get(port)
        except SkillFailure:
            return None

    def prepare(self) -> None:
        """Load and warm up weights and compiled code for the first start, before the run's clock starts."""

    def failure(self, code: str, message: str, **data: object) -> SkillFailure:
        """Return a failure to raise.

        Raises:
            SkillError: the code is none of the class's `failures`, or the message is no text.
        """
        if code not in self.failures:
            raise SkillError(
                type(self).__name__, f"failure code {code} is not declared in its `failures`"
            )
        if not isinstance(message, str):
            raise SkillError(
                type(self).__name__,
                f"the message of {code} is no text but {type(message).__name__}",
            )
        return SkillFailure(Failure(code, shortened(message), data))

    @property
    def context(self) -> SkillContext:
        """Services of the run.

        Raises:
            SkillError: the skill is not bound to a run.
        """
        if self._context is None:
            raise SkillError(type(self).__name__, "is not bound to a run")
        return self._context

    @property
    def clock(self) -> Clock:
        """The cell's clock."""
        return self.context.clock

    def device(self, interface: Callable[..., T]) -> T:
        """The cell's device of an interface, usually a Protocol; its commands are refused once the skill has ended.

        (A Protocol is no `type[T]` for type checkers, but a callable that gives a T.)

        Raises:
            SkillError: the interface is none of the class's `devices`.
        """
        found = cast(type[T], interface)
        if found not in self.devices:
            raise SkillError(
                type(self).__name__, f"uses {found.__name__}, which is not in its `devices`"
            )
        return self.context.device(found, self)

    def optional_device(self, interface: Callable[..., T]) -> T | None:
        """Return the cell's device of an interface, or None where the cell has none.

        Raises:
            SkillError: the interface is in neither `devices` nor `optional_devices`.
        """
        found = cast(type[T], interface)
        if found not in (*self.devices, *self.optional_devices):
            raise SkillError(
                type(self).__name__,
                f"uses {found.__name__}, which is not in its `optional_devices`",
            )
        try:
            return self.context.device(found, self)
        except KeyError:
            return None

    def rng(self) -> np.random.Generator:
        """Return a random generator for this start of this node: reproducible from the run's seed."""
        import numpy as np

        return np.random.default_rng(self.context.seed(f"{self.path}#{self.starts}"))

    def publish(self, topic: str, value: object) -> None:
        """Show a value (an image, a path, a number) to the operator, and record it."""
        self.context.publish(self.path, topic, value)

    def account(self, about: str, words: str, press: float = 0.0) -> None:
        """Add a measurement to the account of the task: see `AccountEntry`."""
        self.publish("account", AccountEntry(about, words, press))

    def compute(
        self, function: Callable[..., T], *arguments: Any, isolated: bool = False
    ) -> Work[T]:
        """Run a function beside the tick: in a thread, or `isolated` in a process that can be killed at once.

        An isolated function and its arguments must be picklable. Use it for work that holds the interpreter's lock.
        The result is there in the next tick at the earliest, however quick the function is.
        """
        computation = self.context.compute(self.path, function, *arguments, isolated=isolated)
        try:
            yield None
            while not computation.done():
                yield None
        except BaseException:
            computation.cancel()
            raise
        result: T = computation.result()
        return result

    def wait(self, duration: float) -> Work[None]:
        """Let `duration` seconds of the run pass."""
        end = self.context.elapsed() + duration
        while self.context.elapsed() < end - 1e-9:
            yield None

    def confirm(self, why: str) -> Work[bool]:
        """Rest in a pause until an operator resumes the run: True. In a run without one False, at once."""
        if not self.context.pause(f"{self.path}: {why}"):
            return False
        yield why
        return True

    # --------------------------------------------------------------------------------- for the tree builder

    def bind(
        self,
        context: SkillContext,
        path: str,
        read: Callable[[], Mapping[str, object]],
        write: Callable[[str, object], None],
    ) -> None:
        """Wire the skill into a run: `read` gives all inputs by port name, `write` takes one output."""
        self._context = context
        self.path = path
        self._read = read
        self._write = write

    def rewire(self, other: Skill) -> None:
        """Take over the inputs and outputs of another node of this class, as a changed file has them."""
        self._read = other._read
        self._write = other._write
        self.changed = {}

    # ------------------------------------------------------------------------------------------- py_trees

    def tick(self) -> Iterator[py_trees.behaviour.Behaviour]:
        # As py_trees' own, without formatting a log line and listing all statuses in every tick.
        if self.status is not Status.RUNNING:
            self.initialise()
        status = self.update()
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self

    def initialise(self) -> None:
        self.reason = None
        self._work = None
        self.feedback_message = ""
        self.starts += 1

    def update(self) -> Status:
        began = time.perf_counter()
        polled = POLLED.set(self.path)
        status = None
        try:
            status = self._poll()
        except SkillFailure as failed:
            self.reason = failed.failure
            touched = bool(self.reason.data.get("unexpected"))
            if touched or self.reason.code in (BLOCKED, "STOPPED"):
                notice = notice_of(self.clock)
                notice.why = self.reason.message
                notice.beside |= touched
            self.feedback_message = str(failed)
            status = Status.FAILURE
        except Interrupted as error:
            self.broke = True
            raise SkillError(
                type(self).__name__, "raised Interrupted without an interruption"
            ) from error
        except BaseException:
            self.broke = True
            raise
        finally:
            leave_if_forked()
            POLLED.reset(polled)
            self.blocked = time.perf_counter() - began
            if status is not Status.RUNNING:
                self.context.release(self)
        return status

    def _poll(self) -> Status:
        if self._work is None:
            obstacle = self.context.acquire(self)
            if obstacle is not None:
                self.feedback_message = obstacle
                return Status.RUNNING
            started = self._body()(**{**self._read(), **self.changed})
            if not isinstance(started, Generator):
                return self._succeed(started)
            self._work = started
        try:
            feedback = next(self._work)
        except StopIteration as stop:
            return self._succeed(stop.value)
        if feedback is not None:
            self.feedback_message = feedback
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        if (
            new_status is Status.INVALID
            and self.status is Status.RUNNING
            and self._work is not None
        ):
            work = self._work
            self._work = None
            self.context.halt(self, work)

    def _body(self) -> Callable[..., Any]:
        body: Callable[..., Any] | None = getattr(
            self, "run", None
        )  # not declared here: each skill's has its own signature
        if body is None:
            raise SkillError(type(self).__name__, "defines no run()")
        return body

    def _succeed(self, outputs: Any) -> Status:
        given = dict(vars(outputs) if isinstance(outputs, Outputs) else outputs or {})
        if given.keys() != self.outputs.keys():
            expected = sorted(self.outputs)
            got = sorted(given)
            raise SkillError(
                type(self).__name__, f"must return the outputs {expected}, returned {got}"
            )
        for name, value in given.items():
            if not self.outputs[name].accepts(value):
                raise SkillError(type(self).__name__, f"output {name} is a {type(value).__name__}")
            self._write(name, value)
        return Status.SUCCESS
