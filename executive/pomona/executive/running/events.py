"""Events of a run, as frozen dataclasses: the one stream that summary, recording and dashboard read.

Every event carries `t`, seconds of the run's clock since the run started, and `tick`. Live and replayed runs give the
same events, so a view handles both alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.reasons import Reason


@dataclass(frozen=True, slots=True)
class Event:
    """Root of all events."""

    t: float
    tick: int


@dataclass(frozen=True, slots=True)
class RunStarted(Event):
    """A run begins. `nodes` describes the tree: one mapping per node, in drawing order, with `path` and `parent`.

    `tree_files` holds the texts of the files that the tree calls, by their path, `cell_files` those that the cell
    includes, by their path from its folder; of a dry run `cell_text` is its mocks. `speed` is the initial ratio of the
    arm's speed to the commanded one; an `OperatorActed` with the action `speed` changes it. `preparation` is the time
    from the order to the start [s]. `parameter_texts` has the values of `parameters` as they are written, with their
    units.
    """

    run: str
    tree: str
    tree_path: str
    tree_text: str
    tree_hash: str
    cell: str
    cell_kind: str
    cell_path: str
    cell_text: str
    seed: int
    parameters: Mapping[str, Any]
    nodes: tuple[Mapping[str, Any], ...]
    versions: Mapping[str, str]
    wall_time: float
    period: float
    settings: Mapping[str, str] = field(default_factory=dict)
    tree_files: Mapping[str, str] = field(default_factory=dict)
    cell_files: Mapping[str, str] = field(default_factory=dict)
    speed: float = 1.0
    preparation: float = 0.0
    parameter_texts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TreeChanged(Event):
    """A paused run goes on with a changed tree file. `nodes` as in `RunStarted`; `difference` is a unified diff."""

    nodes: tuple[Mapping[str, Any], ...]
    difference: str


@dataclass(frozen=True, slots=True)
class StateChanged(Event):
    """The runner's state machine moved on. `pause` numbers the pause in the states pausing and paused, otherwise 0."""

    state: str
    because: str
    pause: int = 0


@dataclass(frozen=True, slots=True)
class NodeChanged(Event):
    """A node's status or feedback changed in this tick; `reason` is there on failure.

    `starts` counts the starts of a skill and the questions of a node that asks: it is the number of its question. Of
    another leaf it counts the starts that its parent interrupted in the same tick.
    """

    path: str
    status: str
    feedback: str
    starts: int
    reason: Reason | None = None


@dataclass(frozen=True, slots=True)
class AttemptEnded(Event):
    """One attempt of a retry ended."""

    path: str
    number: int
    of: int
    succeeded: bool
    reason: Reason | None = None


@dataclass(frozen=True, slots=True)
class PortWritten(Event):
    """A node wrote a value. `sentence` and `facts` describe the value, for the operator and for reports."""

    key: str
    value: Any
    writer: str
    sentence: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Published(Event):
    """A skill shows something: usually one of `pomona.executive.views`."""

    node: str
    topic: str
    value: Any


@dataclass(frozen=True, slots=True)
class Logged(Event):
    """A node logged a line with Python's `logging`, in its own tick or in a thread that computes for it."""

    node: str
    level: str  # name of the level, such as INFO
    text: str


@dataclass(frozen=True, slots=True)
class Computed(Event):
    """A computation beside the tick ended. `wall` is the time that it really took [s]."""

    node: str
    function: str
    wall: float


@dataclass(frozen=True, slots=True)
class TickOverran(Event):
    """The tick took longer than its period; `node` took most of it. `worked` is the processor's time of the tick's
    thread [s]: where it is much less, something was waited for, or the computer had too much to do. None: not known.
    """

    node: str
    duration: float
    worked: float | None = None


@dataclass(frozen=True, slots=True)
class LinkChanged(Event):
    """The state of a device's link changed: 'ok', or the problem."""

    device: str
    state: str


@dataclass(frozen=True, slots=True)
class HandChanged(Event):
    """The contact between the fingers has changed: a sentence, or an empty text without contact."""

    what: str


@dataclass(frozen=True, slots=True)
class OperatorActed(Event):
    """An operator acted on the run."""

    who: str
    action: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class SafeStopped(Event):
    """The cell was brought into its safe state; latched."""

    reason: str


@dataclass(frozen=True, slots=True)
class ErrorRaised(Event):
    """An exception that no skill declares: a bug, a device's fault, or an error of another component."""

    node: str  # path of the node that it came from; empty when it was none
    during: str  # the activity, for the operator: 'the tick', 'the safe stop' …
    error: str  # the exception's name
    message: str  # its text
    place: str  # `file:line, in function`, the innermost outside Pomona and its libraries
    traceback: str  # the whole one


@dataclass(frozen=True, slots=True)
class RunEnded(Event):
    """The run is over.

    `outcome` is success, partial (done in part, or unverified), failure, stopped or error. `account` is the robot's own
    (`account.Account.report`), `truth` the simulated world's score.
    """

    outcome: str
    reason: Reason | None
    ticks: int
    time: float
    wall: float
    truth: Mapping[str, Any] | None
    account: Mapping[str, Any] | None = None


Listener = Callable[[Event], None]
