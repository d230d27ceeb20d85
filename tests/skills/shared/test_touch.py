import numpy as np
import pytest

from drivers.interfaces import WrenchSample
from skills.shared.touch import Touch, load, something_between
from tests.skills.picking_scene import Bench


def feel(bench: Bench, left: tuple[float, float, float], right: tuple[float, float, float], time: float = 0.02) -> None:
    wrenches = np.zeros((2, 6))
    wrenches[0, :3], wrenches[1, :3] = left, right
    bench.fingers.feel = lambda _now: wrenches
    bench.clock.advance(time)


def test_what_is_felt_at_the_beginning_does_not_count():
    bench = Bench()
    feel(bench, (0.5, 0.0, -1.0), (0.0, 0.3, 0.0))
    with Touch(bench.fingers) as touch:
        feel(bench, (0.5, 0.0, -1.0), (0.0, 0.3, 0.0))
        assert touch.change == 0.0
        feel(bench, (0.5, 0.0, -1.0), (0.6, 0.3, 0.8))
    assert touch.change == pytest.approx(1.0)
    assert touch.finger == "right"


def test_the_largest_change_is_remembered_and_a_short_spike_forgotten():
    bench = Bench()
    bench.clock.advance(0.01)
    with Touch(bench.fingers) as touch:
        feel(bench, (9.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.004)
        feel(bench, (0.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.01)
        feel(bench, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.01)
    assert touch.change == pytest.approx(2.0)
    assert touch.finger == "left"


def test_values_that_are_not_finite_are_no_touch():
    bench = Bench()
    bench.clock.advance(0.01)
    with Touch(bench.fingers) as touch:
        for number in range(5):
            bench.fingers.give(WrenchSample(bench.clock.now(), number, np.full((2, 6), np.nan)))
    assert touch.change == 0.0


def test_nothing_is_heard_after_the_end():
    bench = Bench()
    bench.clock.advance(0.01)
    with Touch(bench.fingers) as touch:
        pass
    feel(bench, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert touch.change == 0.0


def test_load_feels_weight_and_is_blind_to_the_pressing_force():
    bench = Bench()
    feel(bench, (0.4, 0.1, -2.0), (0.4, -0.1, -2.0))  # 0.8 N along x, 0.2 N along y, squeezed by 2 N
    with Touch(bench.fingers, load) as touch:
        feel(bench, (0.4, 0.1, -5.0), (0.4, -0.1, -5.0))
        assert touch.change == pytest.approx(0.0)
        feel(bench, (0.0, 0.0, -2.0), (0.0, 0.0, -2.0))
    assert touch.change == pytest.approx(np.hypot(0.8, 0.2))


def test_a_stream_that_stands_still_is_stale():
    bench = Bench()
    bench.clock.advance(0.01)
    with Touch(bench.fingers) as touch:
        assert touch.stale_for(bench.clock.now()) == 0.0
        bench.fingers.lose(1.0)
        bench.clock.advance(0.5)
        assert touch.stale_for(bench.clock.now()) == pytest.approx(0.5, abs=0.01)


def test_something_is_held_only_when_both_fingers_press_and_stand_apart():
    bench = Bench(width=0.07)
    feel(bench, (0.0, 0.0, -1.0), (0.0, 0.0, -1.0))
    assert something_between(bench.gripper, bench.fingers)
    feel(bench, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    assert not something_between(bench.gripper, bench.fingers)
    closed = Bench(width=0.035)
    feel(closed, (0.0, 0.0, -1.0), (0.0, 0.0, -1.0))
    assert not something_between(closed.gripper, closed.fingers)
