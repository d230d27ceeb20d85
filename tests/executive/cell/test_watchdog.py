"""The watchdog of a streamed command, on clocks that jump."""

from __future__ import annotations

import pytest

from pomona.executive.cell.owner import Watchdog


def test_a_command_lasts_as_long_as_the_limit_and_each_renewal_begins_anew() -> None:
    watchdog = Watchdog(0.1)
    assert watchdog.has_expired(0.0)
    watchdog.renew(1.0)
    assert not watchdog.has_expired(1.1)
    watchdog.renew(1.1)
    assert not watchdog.has_expired(1.2)
    assert watchdog.has_expired(1.201)
    assert watchdog.has_expired(1.15)


@pytest.mark.parametrize("back", [0.03, 0.5, 5.0, 3600.0])
def test_a_clock_that_steps_back_costs_one_interval_and_no_more(back: float) -> None:
    watchdog, offset, lasted = Watchdog(0.1), 0.0, 0
    watchdog.renew(0.0)
    for step in range(1, 200):
        offset = back if step >= 10 else 0.0  # after 20 ms
        if watchdog.has_expired(0.002 * step - offset):
            lasted = step
            break
    assert (
        lasted == 52
    )  # 50 intervals of 2 ms, the next one is too much; the step back itself was none


def test_a_clock_that_steps_forward_ends_the_command() -> None:
    watchdog = Watchdog(0.1)
    watchdog.renew(0.0)
    assert watchdog.has_expired(3600.0)
