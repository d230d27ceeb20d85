"""Base of the skills that read and write signals: their names are checked against the cell before a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar

from pomona.devices.plc.signals import SignalNames, Signals
from pomona.executive import CellFacts, Problem, Skill, SkillFailure, choose


class SignalSkill(Skill):
    """A skill on signals.

    Attributes:
        input_ports, output_ports: ports with the name of an input, or of an output.
    """

    devices: ClassVar[tuple[type, ...]] = (Signals,)
    moves: ClassVar[tuple[type, ...] | None] = ()
    input_ports: ClassVar[tuple[str, ...]] = ()
    output_ports: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Check that the named signals are the cell's."""
        names = None if cell is None else cell.known(SignalNames)
        if cell is None or names is None:
            return
        for kind, ports, there in (
            ("input", cls.input_ports, names.inputs),
            ("output", cls.output_ports, names.outputs),
        ):
            for port in ports:
                name = known.get(port)
                if name is not None and name not in there:
                    message = f"the PLC of the cell '{cell.name}' has no {kind} '{name}'"
                    yield Problem(port, message, choose(name, there))

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> Iterable[str]:
        """Return the cell's signals."""
        names = None if cell is None else cell.known(SignalNames)
        if names is None:
            return ()
        return (
            names.inputs
            if port in cls.input_ports
            else names.outputs
            if port in cls.output_ports
            else ()
        )

    def reading(self, name: str, **data: object) -> bool | float:
        """Return an input's value. Fails with NO_SIGNAL: the cell has none; SIGNAL_UNKNOWN: it is past its deadline."""
        signals = self.device(Signals)
        if name not in signals.names.inputs:
            raise self._no_signal(name, signals.names.inputs)
        found = signals.read(name)
        if found.value is None:
            words = f"the signal '{name}' is unknown: the PLC's newest value is {1e3 * found.age:.0f} ms old"
            raise self.failure("SIGNAL_UNKNOWN", words, signal=name, age_s=found.age, **data)
        return found.value

    def require_output(self, name: str) -> None:
        """Fail with NO_SIGNAL unless the cell has the output."""
        names = self.device(Signals).names
        if name not in names.outputs:
            raise self._no_signal(name, names.outputs)

    def _no_signal(self, name: str, there: Iterable[str]) -> SkillFailure:
        words = f"the PLC has no such signal '{name}'; it has {', '.join(there) or 'none'}"
        return self.failure("NO_SIGNAL", words, signal=name)
