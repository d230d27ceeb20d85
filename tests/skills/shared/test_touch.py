import numpy as np
import pytest

from pomona.drivers.interfaces import WrenchSample
from pomona.skills.shared.touch import Touch, load, something_between
from tests.skills.picking_scene import PickingScene


def feel(
    scene: PickingScene,
    left: tuple[float, float, float],
    right: tuple[float, float, float],
    time: float = 0.02,
) -> None:
    wrenches = np.zeros((2, 6))
    wrenches[0, :3], wrenches[1, :3] = left, right
    scene.fingers.feel = lambda _now: wrenches
    scene.clock.advance(time)


def test_contact_at_the_beginning_does_not_count():
    scene = PickingScene()
    feel(scene, (0.5, 0.0, -1.0), (0.0, 0.3, 0.0))
    with Touch(scene.fingers) as touch:
        feel(scene, (0.5, 0.0, -1.0), (0.0, 0.3, 0.0))
        assert touch.change == pytest.approx(0.0, abs=1e-9)
        feel(scene, (0.5, 0.0, -1.0), (0.6, 0.3, 0.8))
    assert touch.change == pytest.approx(1.0)
    assert touch.finger == "right"


def test_the_noise_of_the_first_sample_is_no_change():
    scene = PickingScene()
    feel(scene, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(40):
        scene.fingers.feel = lambda _now: rng.normal(0.0, 0.04, (2, 6))
        scene.clock.advance(0.02)
        with Touch(scene.fingers, load) as touch:
            scene.clock.advance(0.2)
            errors.append(float(np.linalg.norm(touch.average() - touch._reference)))
    assert max(errors) < 0.09  # of one sample: 0.18


def test_the_largest_change_is_remembered_and_a_short_spike_forgotten():
    scene = PickingScene()
    scene.clock.advance(0.01)
    with Touch(scene.fingers) as touch:
        feel(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        feel(scene, (9.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.004)
        feel(scene, (0.0, 2.0, 0.0), (0.0, 0.0, 0.0), 0.01)
        feel(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.01)
    assert touch.change == pytest.approx(2.0)
    assert touch.finger == "left"


def test_values_that_are_not_finite_are_no_touch():
    scene = PickingScene()
    scene.clock.advance(0.01)
    with Touch(scene.fingers) as touch:
        for number in range(5):
            scene.fingers.give(WrenchSample(scene.clock.now(), number, np.full((2, 6), np.nan)))
    assert touch.change == 0.0


def test_a_change_beyond_the_limit_acts_once_in_the_sensors_own_loop():
    scene = PickingScene()
    scene.clock.advance(0.01)
    acted: list[float] = []
    with Touch(scene.fingers) as touch:
        touch.at_change(1.5, lambda: acted.append(scene.clock.now()))
        feel(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        feel(scene, (0.0, 0.0, 0.0), (1.4, 0.0, 0.0))
        assert acted == []
        begun = scene.clock.now()
        feel(scene, (0.0, 0.0, 0.0), (1.6, 0.0, 0.0))
        feel(scene, (0.0, 0.0, 0.0), (5.0, 0.0, 0.0))
    assert acted == [pytest.approx(begun + 0.006, abs=1e-3)]  # three samples: one may be a spike


def test_nothing_is_heard_after_the_end():
    scene = PickingScene()
    scene.clock.advance(0.01)
    with Touch(scene.fingers) as touch:
        pass
    feel(scene, (5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert touch.change == 0.0


def test_load_feels_weight_and_is_blind_to_the_pressing_force():
    scene = PickingScene()
    feel(
        scene, (0.4, 0.1, -2.0), (0.4, -0.1, -2.0)
    )  # 0.8 N along x, 0.2 N along y, squeezed by 2 N
    with Touch(scene.fingers, load) as touch:
        feel(scene, (0.4, 0.1, -5.0), (0.4, -0.1, -5.0))
        assert touch.change == pytest.approx(0.0)
        feel(scene, (0.0, 0.0, -2.0), (0.0, 0.0, -2.0))
    assert touch.change == pytest.approx(np.hypot(0.8, 0.2))


def test_a_stream_that_stands_still_is_stale():
    scene = PickingScene()
    scene.clock.advance(0.01)
    with Touch(scene.fingers) as touch:
        assert touch.stale_for(scene.clock.now()) == 0.0
        scene.fingers.lose(1.0)
        scene.clock.advance(0.5)
        assert touch.stale_for(scene.clock.now()) == pytest.approx(0.5, abs=0.01)


def test_something_is_held_only_when_both_fingers_press_and_stand_apart():
    scene = PickingScene(width=0.07)
    feel(scene, (0.0, 0.0, -1.0), (0.0, 0.0, -1.0))
    assert something_between(scene.gripper, scene.fingers)
    feel(scene, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
    assert not something_between(scene.gripper, scene.fingers)
    closed = PickingScene(width=0.035)
    feel(closed, (0.0, 0.0, -1.0), (0.0, 0.0, -1.0))
    assert not something_between(closed.gripper, closed.fingers)


@pytest.mark.parametrize("rate", [100.0, 500.0, 2000.0])
def test_an_average_takes_the_same_time_at_any_rate_of_samples(rate):
    scene = PickingScene()
    scene.clock.advance(0.01)
    scene.fingers.rate = rate
    with Touch(scene.fingers) as touch:
        for number in range(round(rate)):
            wrenches = np.zeros((2, 6))
            wrenches[:, 0] = number / rate  # 1 N in a second
            scene.fingers.give(WrenchSample(number / rate, number, wrenches))
        assert touch.average().shape == (2, 3)
        assert touch.average()[0, 0] == pytest.approx(1.0 - 0.05, abs=0.006)
