from types import SimpleNamespace

import numpy as np
import pytest

from pomona.drivers.interfaces import ForceSensor, LoadSensor, PressSensor, WrenchSample
from pomona.skills.shared.touch import (
    Touch,
    each_finger,
    feels_support,
    felt,
    hand_felt,
    load,
    pressing_forces,
    something_between,
    weighing,
)
from pomona.tools.mock import MockForceSensor, MockGripper
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


def cell_with(**sensors):
    """Stands for a skill of a cell with these sensors."""
    kinds = {"fingers": ForceSensor, "load": LoadSensor, "tips": PressSensor}
    there = {kinds[name]: sensor for name, sensor in sensors.items()}
    return SimpleNamespace(optional_device=there.get)


class Hand(MockForceSensor):
    """A load sensor: what it carries [kg], and its smallest change [N]."""

    def __init__(self, clock, mass=0.4, least=0.6):
        super().__init__(clock, lambda _now: np.zeros((1, 6)))
        self.mass, self.least = mass, least


def test_a_change_is_forgotten_and_its_reference_is_not():
    scene = PickingScene()
    feel(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with Touch(scene.fingers) as touch:
        feel(scene, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        feel(scene, (0.0, 0.0, 0.0), (0.0, 2.0, 0.0))
        assert (touch.change, touch.finger) == (pytest.approx(2.0), "right")
        touch.forget_change()
        assert (touch.change, touch.finger) == (0.0, "")
        assert touch.present == pytest.approx(2.0)
        feel(scene, (0.0, 0.0, 0.0), (0.0, 1.5, 0.0))
        assert touch.change == pytest.approx(2.0, abs=0.51)  # no less than what is there
        assert touch.present == pytest.approx(1.5)


def test_what_is_there_must_be_there_for_three_samples():
    scene = PickingScene()
    with Touch(scene.fingers) as touch:
        for number, force in enumerate((0.0, 3.0, 4.0, 5.0)):
            wrenches = np.zeros((2, 6))
            wrenches[1, 0] = force
            touch._reference = np.zeros((2, 3))
            touch._first = 0
            scene.fingers.give(WrenchSample(0.001 * number, number, wrenches))
            assert touch.present == pytest.approx((0.0, 0.0, 0.0, 3.0)[number])


def test_the_reference_is_the_mean_of_the_first_ten_milliseconds():
    scene = PickingScene()
    scene.fingers.rate = 500.0
    with Touch(scene.fingers) as touch:
        for number, force in enumerate((1.0, 2.0, 3.0, 4.0, 5.0, 9.0)):
            wrenches = np.zeros((2, 6))
            wrenches[0, 2] = force
            scene.fingers.give(WrenchSample(0.002 * number, number, wrenches))
        assert touch.at_first() == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("before", "now", "back"),
    [
        ((0.0, 3.0), (0.0, 1.0), 2.0),
        ((0.0, 3.0), (0.0, 5.0), -2.0),
        ((4.0, 3.0), (0.0, 0.0), 5.0),
        ((0.0, -3.0), (0.0, 0.0), 3.0),
        ((0.0, 3.0), (7.0, 3.0), 0.0),  # across it
        ((0.0, 0.0), (1.0, 0.0), 0.0),  # nothing has changed before
    ],
)
def test_how_far_a_load_has_gone_back_is_measured_along_its_change(before, now, back):
    start = np.array([[1.0, -2.0]])
    touch = Touch(None, load)
    touch._reference = start
    assert touch.gone_back(start + before, start + now) == pytest.approx(back)
    both = np.vstack([start, start])
    touch._reference = both
    least = touch.gone_back(
        both + np.array([before, (0.0, 9.0)]), both + np.array([now, (0.0, 9.0)])
    )
    assert least == pytest.approx(min(back, 0.0))


def test_without_a_sensor_nothing_changes():
    with Touch(None) as touch:
        assert (touch.change, touch.present, touch.at_first()) == (0.0, 0.0, 0.0)
        assert touch.stale_for(1e6) == 0.0
        assert touch.limit(0.4, 2.0) == 0.4


def test_a_sensor_above_the_hand_shows_a_contact_beside_the_inertia_of_the_hand():
    scene = PickingScene()
    hand = Hand(scene.clock)
    scene.clock.advance(0.1)
    with Touch(hand) as touch:
        assert touch.limit(0.5, 2.0) == pytest.approx(0.6 + 0.8)
        assert touch.limit(0.7, 2.0) == pytest.approx(0.7 + 0.8)
        assert touch.limit(0.7, 0.0) == pytest.approx(0.7)
        scene.clock.advance(0.1)
        wrenches = np.zeros((1, 6))
        wrenches[0, 2] = 9.0
        hand.feel = lambda _now: wrenches
        scene.clock.advance(0.1)
        assert touch.at_first() == 0.0  # its zero is not known
        assert touch.change == pytest.approx(9.0)
        assert touch.finger == ""


def test_a_sensor_that_gave_no_sample_is_stale_for_ever_and_an_old_sample_from_a_tenth_on():
    scene = PickingScene()
    with Touch(scene.fingers) as touch:
        assert touch.stale_for(1.0) == np.inf
        scene.fingers.give(WrenchSample(1.0, 1, np.zeros((2, 6))))
        assert touch.stale_for(1.099) == 0.0
        assert touch.stale_for(1.102) == pytest.approx(0.102)


def test_the_sensor_that_feels_best_is_listened_to():
    clock = PickingScene().clock
    fingers, tips, hand = MockForceSensor(clock), MockForceSensor(clock), Hand(clock)

    def heard(listen, *args, **sensors):
        touch = listen(cell_with(**sensors), *args)
        return None if touch is None else touch._sensor

    assert heard(felt, fingers=fingers, load=hand, tips=tips) is fingers
    assert heard(felt, load=hand, tips=tips) is tips
    assert heard(felt, load, load=hand, tips=tips) is hand
    assert heard(felt, load=hand) is hand
    assert heard(felt) is None
    assert heard(hand_felt, fingers=fingers, load=hand) is hand
    assert heard(hand_felt, load=hand) is None  # `felt` listens to it
    assert heard(hand_felt, fingers=fingers) is None
    assert heard(weighing, fingers=fingers, load=hand) is None
    assert heard(weighing, load=hand) is hand
    assert heard(weighing) is None
    assert felt(cell_with(fingers=fingers))._of is each_finger
    assert felt(cell_with(fingers=fingers), load)._of is load
    assert felt(cell_with(load=hand), load)._of is each_finger


@pytest.mark.parametrize(("least", "feels"), [(0.9, True), (1.0, True), (1.1, False)])
def test_a_load_sensor_feels_a_support_when_it_is_fine_enough(least, feels):
    clock = PickingScene().clock
    hand = Hand(clock, least=least)
    assert feels_support(cell_with(load=hand)) is feels
    assert (weighing(cell_with(load=hand)) is not None) is feels
    assert feels_support(cell_with(load=hand, fingers=MockForceSensor(clock)))
    assert not feels_support(cell_with())


def test_pressing_forces_are_positive_and_in_their_order():
    scene = PickingScene()
    scene.fingers = MockForceSensor(scene.clock)
    assert pressing_forces(scene.fingers) == (0.0, 0.0)
    feel(scene, (9.0, 9.0, -1.0), (9.0, 9.0, 2.0))
    assert pressing_forces(scene.fingers) == pytest.approx((1.0, -2.0))


@pytest.mark.parametrize(
    ("force", "above", "held"),
    [(0.26, 2.1e-3, True), (0.24, 2.1e-3, False), (0.26, 1.9e-3, False)],
)
def test_a_fruit_between_the_fingers_presses_and_keeps_them_open(force, above, held):
    scene = PickingScene()
    scene.gripper = MockGripper(scene.clock, scene.gripper.limits.width_min + above)
    for left, right in ((force, 1.0), (1.0, force)):
        feel(scene, (0.0, 0.0, -left), (0.0, 0.0, -right))
        assert something_between(scene.gripper, scene.fingers) is held
