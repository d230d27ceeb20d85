"""Skills on the signals of a PLC: wait for one, set one, and a handshake of four edges."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple
from weakref import WeakKeyDictionary

from pomona.devices.plc.signals import SignalNames, Signals
from pomona.drivers import MotionRefused
from pomona.executive import (
    TIME,
    CellFacts,
    Outputs,
    Port,
    Problem,
    Skill,
    Time,
    Work,
    choose,
)

_OFF: WeakKeyDictionary[object, dict[str, float]] = WeakKeyDictionary()
"""By the run's clock: when each input was last seen off [s]."""
_LACKED: WeakKeyDictionary[object, tuple[object, ...]] = WeakKeyDictionary()
"""By the run's clock: what the task lacked at the last SetPartial, as `lacking`."""


class SignalLook(NamedTuple):
    """A signal as it is, the words for its wanted value, and whether it has it."""

    signal: str
    wanted: str
    value: bool | float | None
    is_met: bool


class SignalSkill(Skill):
    """Base of the skills on signals: the names of signals are checked against the cell before a run.

    Attributes:
        input_ports, output_ports: ports with the name of an input, or of an output.
    """

    devices = (Signals,)
    moves: ClassVar[tuple[type, ...] | None] = ()
    input_ports: ClassVar[tuple[str, ...]] = ()
    output_ports: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Check that the named signals are the cell's."""
        for port, there in cls._choices(cell).items():
            name = known.get(port)
            if name is not None and name not in there:
                kind = "input" if port in cls.input_ports else "output"
                yield Problem(port, f"the cell's PLC has no {kind} '{name}'", choose(name, there))

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> Iterable[str]:
        """Return the cell's signals."""
        return cls._choices(cell).get(port, ())

    @classmethod
    def _choices(cls, cell: CellFacts | None) -> Mapping[str, tuple[str, ...]]:
        """Return the cell's signals for each port; nothing if they are unknown."""
        names = None if cell is None else cell.known(SignalNames)
        if names is None:
            return {}
        inputs = dict.fromkeys(cls.input_ports, names.inputs)
        return inputs | dict.fromkeys(cls.output_ports, names.outputs)

    def reading(self, name: str, **data: object) -> bool | float:
        """Return an input's value. Fails with NO_SIGNAL: the cell has none; SIGNAL_UNKNOWN: it is past its deadline."""
        signals = self.device(Signals)
        self.require(name, signals.names.inputs)
        found = signals.read(name)
        if found.value is None:
            words = f"the signal '{name}' is unknown: the PLC's newest value is {1e3 * found.age:.0f} ms old"
            raise self.failure("SIGNAL_UNKNOWN", words, signal=name, age_s=found.age, **data)
        return found.value

    def set_output(self, name: str, value: bool | float, **data: object) -> None:
        """Command an output. Fails with NO_SIGNAL: the cell has none; SIGNAL_REFUSED: the PLC's driver refuses."""
        signals = self.device(Signals)
        self.require(name, signals.names.outputs)
        try:
            signals.write(name, value)
        except MotionRefused as refused:
            raise self.failure("SIGNAL_REFUSED", refused.message, signal=name, **data) from refused

    def require(self, name: str, there: Iterable[str]) -> None:
        """Fail with NO_SIGNAL unless the cell has the signal."""
        if name not in there:
            words = f"the PLC has no such signal '{name}'; it has {', '.join(there) or 'none'}"
            raise self.failure("NO_SIGNAL", words, signal=name)

    def until(
        self, look: Callable[[], SignalLook], within: float, late: str, **data: object
    ) -> Work[SignalLook]:
        """Wait until a signal has its wanted value; past the deadline [s] fail with the code `late`."""
        signals = self.device(Signals)
        began = self.context.elapsed()
        off = _OFF.setdefault(self.clock, {})
        while True:
            for name in signals.names.inputs:
                if signals.read(name).value == 0:
                    off[name] = self.clock.now()
            if (seen := look()).is_met:
                return seen
            waited = self.context.elapsed() - began
            if waited >= within - 1e-9:
                missed = f"'{seen.signal}' was not {seen.wanted} within {within:g} s"
                raise self.failure(
                    late,
                    f"{missed}; it is {_shown(seen.value)}",
                    signal=seen.signal,
                    value=seen.value,
                    waited_s=waited,
                    **data,
                )
            yield f"waiting until '{seen.signal}' is {seen.wanted}"


class SeenSignal(Outputs):
    """Outputs of WaitSignal."""

    value: Annotated[float, Port(help="value of the signal; 1 of a switch that is on")]


class WaitSignal(SignalSkill):
    """Wait until an input of the PLC is on or off, or a number is within limits.

    A value past its deadline is unknown: the skill fails, and it counts as neither on nor off. `within: 0 s` asks once.
    A switch that is waited for must rise: one that is on already starts nothing, unless `level`.
    """

    failures = ("SIGNAL_TIMEOUT", "SIGNAL_UNKNOWN", "NO_SIGNAL")
    input_ports = ("signal",)

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Let the author say whether a switch that is on already counts."""
        yield from super().judge(known, cell)
        number = known.get("least") is not None or known.get("most") is not None
        if (
            known.get("state")
            and known.get("within")
            and not number
            and known.get("level", 1) is None
        ):
            words = "a switch that is on already is waited for in vain, a fault as well"
            hint = "write `level: false` for an order, `level: true` for a fault"
            yield Problem("", words, hint, warning=True)

    def run(
        self,
        signal: Annotated[str, Port(help="name of an input in the cell file")],
        state: Annotated[bool, Port(help="whether a switch must be on or off")] = True,
        least: Annotated[float | None, Port(help="smallest value of a number")] = None,
        most: Annotated[float | None, Port(help="largest value of a number")] = None,
        level: Annotated[
            bool | None, Port(help="whether a switch that is on already counts; false if omitted")
        ] = None,
        within: Annotated[Time, Port(min="0 s", help="deadline; 0 s asks once")] = TIME("1 min"),
    ) -> Work[SeenSignal]:
        ends = ("at least", least), ("at most", most)
        # an input that was off so shortly before it was waited for has risen for this wait [s]
        since = self.clock.now() - 0.5
        rises = state and within and not level
        limits = [f"{word} {limit:g}" for word, limit in ends if limit is not None]

        def look() -> SignalLook:
            value = self.reading(signal)
            if not limits:
                risen = not rises or _OFF[self.clock].get(signal, -1.0) >= since
                wanted = _shown(state) if risen else "on anew"
                return SignalLook(signal, wanted, value, risen and bool(value) == state)
            fits = (least is None or value >= least) and (most is None or value <= most)
            return SignalLook(signal, " and ".join(limits), value, fits)

        seen = yield from self.until(look, within, "SIGNAL_TIMEOUT")
        return SeenSignal(value=float(seen.value or 0.0))


TAKEN = TIME("500 ms")


class OutputSkill(SignalSkill):
    """Base of the skills that set one output."""

    moves = (Signals,)
    failures = ("SIGNAL_NOT_TAKEN", "SIGNAL_REFUSED", "NO_SIGNAL")
    output_ports = ("signal",)

    def accepted(self, signal: str, value: bool | float, within: float) -> Work[None]:
        """Set an output and wait until the PLC has accepted it, at most this time [s]."""
        self.set_output(signal, value)
        asked = self.clock.now()

        def look() -> SignalLook:
            taken = self.device(Signals).read(signal)
            is_accepted = taken.value == value and taken.stamp >= asked
            return SignalLook(signal, f"accepted as {value:g}", taken.value, is_accepted)

        yield from self.until(look, within, "SIGNAL_NOT_TAKEN")


class SetSignal(OutputSkill):
    """Set an output to the PLC, and wait until the PLC has accepted it; it stays until it is set again."""

    def run(
        self,
        signal: Annotated[str, Port(help="name of an output in the cell file")],
        state: Annotated[bool, Port(help="whether a switch is on or off")] = True,
        number: Annotated[float | None, Port(help="value of a number")] = None,
        within: Annotated[Time, Port(min="0 s", help="deadline of the PLC's acceptance")] = TAKEN,
    ) -> Work[None]:
        yield from self.accepted(signal, state if number is None else number, within)


class SetPartial(OutputSkill):
    """Set an output on if since the last SetPartial the task lacks something more, or no success was measured; else off.

    It lacks fruit that was left, passed or pressed beyond its limit; the output stays until it is set again.
    """

    def run(
        self,
        signal: Annotated[str, Port(help="name of an output in the cell file")],
    ) -> Work[None]:
        verified, *lacking = self.context.lacking
        before = _LACKED.get(self.clock, (0, 0))
        _LACKED[self.clock] = (verified, *lacking)
        more = verified == before[0] or bool(Counter(lacking) - Counter(before[1:]))
        yield from self.accepted(signal, more, TAKEN)


class Handshake(SignalSkill):
    """Let the PLC do something: request, accepted, done, released; each edge has its deadline.

    The output `request` rises when both inputs are off. The PLC answers with `accepted`, then `done`; the request
    falls, and both inputs must fall. After a failure or an interruption the request is withdrawn.
    """

    moves = (Signals,)
    failures = ("EDGE_MISSED", "SIGNAL_UNKNOWN", "SIGNAL_REFUSED", "NO_SIGNAL")
    input_ports = ("accepted", "done")
    output_ports = ("request",)

    def run(
        self,
        request: Annotated[str, Port(help="output that asks the PLC")],
        accepted: Annotated[str, Port(help="input by which the PLC accepts")],
        done: Annotated[str, Port(help="input by which the PLC reports the end")],
        request_within: Annotated[
            Time,
            Port(min="0 s", help="deadline of the request: both inputs off, the output accepted"),
        ] = TIME("1 s"),
        accepted_within: Annotated[
            Time, Port(min="0 s", help="deadline of `accepted` after the request")
        ] = TIME("1 s"),
        done_within: Annotated[
            Time, Port(min="0 s", help="deadline of `done` after `accepted`")
        ] = TIME("30 s"),
        released_within: Annotated[
            Time, Port(min="0 s", help="deadline of both falls after `done`")
        ] = TIME("1 s"),
    ) -> Work[None]:
        names = self.device(Signals).names
        both = {accepted: False, done: False}
        for name in both:
            self.require(name, names.inputs)
        self.require(request, names.outputs)
        yield from self._edge("request", both, request_within)
        try:
            self.set_output(request, True, edge="request")
            yield from self._edge("request", {request: True}, request_within)
            yield from self._edge("accepted", {accepted: True}, accepted_within)
            yield from self._edge("done", {done: True}, done_within)
        finally:
            # at a safe stop the device itself has withdrawn the request, and refuses
            with contextlib.suppress(MotionRefused):
                self.device(Signals).write(request, False)
        yield from self._edge("released", {request: False, **both}, released_within)

    def _edge(self, edge: str, wanted: Mapping[str, bool], within: float) -> Work[SignalLook]:
        """Wait until signals have values; a failure names the edge and the first signal that has another one."""
        signals = self.device(Signals)

        def look() -> SignalLook:
            for name, on in wanted.items():
                is_ours = name in signals.names.outputs
                value = signals.read(name).value if is_ours else self.reading(name, edge=edge)
                seen = SignalLook(name, _shown(on), value, bool(value) == on)
                if not seen.is_met:
                    break
            return seen

        return (yield from self.until(look, within, "EDGE_MISSED", edge=edge))


def _shown(value: bool | float | None) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return "unknown" if value is None else f"{value:g}"
