"""Speed of a run's arm: a ratio to the commanded speed, set by the operator for the run, by a tree for a part of it."""

from __future__ import annotations

from pomona.executive.errors import PomonaError
from pomona.executive.ports import RATIO, Port

# allowed range of the speed ratio; below a tenth, motions would exceed the timeouts of a tree
LEAST = 0.1
MOST = 1.0

SHARE = Port(RATIO, min=LEAST, max=MOST)


class SpeedRefusedError(PomonaError):
    """A speed outside the allowed range."""


def speed_of(text: str) -> float:
    """Parse a speed such as `30 %` as a ratio. Raises SpeedRefusedError: it is none, or not from 10 % to 100 %."""
    try:
        share = RATIO.parse(text)
    except ValueError as error:
        raise SpeedRefusedError(f"{error}, such as '30 %'") from None
    return checked_speed(share, text)


def checked_speed(share: float, written: str = "") -> float:
    """Return the share itself. Raises SpeedRefusedError: it is not from 10 % to 100 %."""
    if not LEAST - 1e-9 <= share <= MOST + 1e-9:  # NaN, too
        raise SpeedRefusedError(
            f"a speed is 10 % to 100 %, not {written.strip() or words_of(share)}{_hint(written, share)}"
        )
    return min(max(share, LEAST), MOST)


def _hint(written: str, share: float) -> str:
    percent = 100.0 * LEAST <= share <= 100.0 * MOST and "%" not in written
    return f": did you mean {share:.4g} %?" if percent else ""


def words_of(share: float) -> str:
    """`30 %`."""
    return f"{100.0 * share:.4g} %"


def cannot_slow(devices: tuple[str, ...]) -> str:
    """Why a run with these devices goes at full speed only."""
    return f"{', '.join(devices)}: the driver cannot move it more slowly than it is commanded"
