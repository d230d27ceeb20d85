"""When a rate goes out to the gripper."""

from __future__ import annotations

from itertools import pairwise

from pomona.skills.grip.command_timing import CommandTiming


def times_of(rates: list[float], holding: bool = True) -> list[float]:
    """When rates [m/s], wanted sample by sample at 500 Hz, go out [s]."""
    timing, sent, before = CommandTiming(500.0), [], 0.0
    for n, rate in enumerate(rates):
        if timing.pass_time(1) and timing.goes_out(rate, before, holding):
            sent.append(0.002 * n)
            before = rate
    return sent


def gaps(times: list[float]) -> list[float]:
    return [round(b - a, 4) for a, b in pairwise(times)]


def test_never_two_within_twenty_milliseconds() -> None:
    rates = [0.01 * (-1) ** n for n in range(500)]
    assert min(gaps(times_of(rates))) == 0.02


def test_a_continued_command_is_sent_again_within_the_watchdogs_time() -> None:
    assert max(gaps(times_of([-0.001] * 1000))) == 0.06


def test_rest_is_reported_twice_a_second() -> None:
    assert gaps(times_of([0.0] * 1500))[-2:] == [0.5, 0.5]


def test_trims_wait_only_when_it_has_been_calm() -> None:
    trims = [0.0005 * (-1) ** (n // 10) for n in range(600)]
    spread = gaps(times_of([0.05] * 10 + trims))
    assert spread[:7] == [0.02] * 7
    assert spread[-5:] == [0.06] * 5
    stirred = gaps(times_of(trims + [0.05] * 10 + trims[:100]))
    assert stirred[-8:] == [0.02] * 8


def test_urgent_messages_go_out_at_once_when_the_channel_is_free() -> None:
    rates = [0.0] * 700 + [-0.05] * 10
    assert 1.4 in [round(t, 4) for t in times_of(rates)]


def test_before_the_hold_every_rate_goes_out() -> None:
    assert max(gaps(times_of([0.0] * 1000, holding=False))) == 0.02
