"""The watchdog of a streamed command, one for every driver."""

from __future__ import annotations

import math


class Watchdog:
    """Ends a command that is not renewed.

    It adds up the intervals between calls of `has_expired`, and an interval is never negative: a clock that steps back
    costs one interval, and cannot keep a command alive.
    """

    def __init__(self, limit: float) -> None:
        """Expired until the first `renew`.

        Args:
            limit: a command ends when it is older than this [s].
        """
        self.limit = limit
        self._age, self._looked_at = math.inf, 0.0

    def renew(self, now: float) -> None:
        """A command has come.

        Args:
            now: the cell's clock [s].
        """
        self._age, self._looked_at = 0.0, now

    def has_expired(self, now: float) -> bool:
        """Return True when the command is too old; called again and again.

        Args:
            now: the cell's clock [s].
        """
        self._age += max(now - self._looked_at, 0.0)
        self._looked_at = now
        return self._age > self.limit + 1e-9
