"""Signals whose inputs a test sets."""

from __future__ import annotations

from collections.abc import Mapping

from pomona.devices.plc.simulated import SimInputFile, SimSignals, SimSignalsFile
from pomona.executive import Clock


class MockSignals(SimSignals):
    """Signals whose inputs a test sets.

    Attributes:
        values: of the inputs.
    """

    def __init__(
        self, clock: Clock, inputs: Mapping[str, bool | float], outputs: tuple[str, ...] = ()
    ) -> None:
        rules = {
            name: SimInputFile(number=None if isinstance(value, bool) else value)
            for name, value in inputs.items()
        }
        super().__init__(clock, SimSignalsFile(inputs=rules, outputs=outputs))
        self.values = dict(inputs)

    def input_at(self, name: str, t: float) -> bool | float:
        return self.values[name]
