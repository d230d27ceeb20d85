"""Conditions of nodes: an expression that is true or false, and the values that it reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pomona.executive.reasons import NoValue


class Condition:
    """An expression with the values that it reads, for the sentence that explains a false result."""

    def __init__(
        self, text: str, holds: Callable[[], bool], read: Mapping[str, Callable[[], object]] | None = None
    ) -> None:
        self.text, self.holds, self._read = text, holds, dict(read or {})

    def values(self) -> dict[str, object]:
        """Return the current values of the names in the expression."""
        found: dict[str, object] = {}
        for name, get in self._read.items():
            try:
                value = get()
            except NoValue:
                continue
            found[name] = value if isinstance(value, (bool, int, float, str)) or value is None else str(value)[:80]
        return found

    def sentence(self) -> str:
        """`{width} > 0.05 is false: width is 0.03`."""
        shown = ", ".join(
            f"{n} is {v:.6g}" if isinstance(v, float) else f"{n} is {v}" for n, v in self.values().items()
        )
        return f"{self.text} is false" + (f": {shown}" if shown else "")
