"""The law that chooses the grasp force, fed with loads that are made up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import HELD, GripMode, GripPhase
from pomona.skills.grip.reference import ForceReference
from pomona.skills.grip.settings import ForceLaw, GripSettings

PERIOD = 0.002
MARGIN = 1.1


def load(
    coulomb: float, share: float = 1.0, noise: float = 0.0, rise: float = 0.0, **changes: Any
) -> GripEstimate:
    """Estimate of a fruit whose moment makes the minimum force `share` times Coulomb's."""
    least, f_t = coulomb * share, 0.6 * coulomb
    estimate = GripEstimate(
        f_coulomb=coulomb, f_least=least, f_reserved=least, f_cautious=1.5 * least, f_t=f_t, load=(f_t, 0.0),
        f_least_rise=rise, f_least_std=noise, twist=share - 1.0, f_n=least,
    )  # fmt: skip
    return estimate._replace(**changes)


def lifted(settings: GripSettings) -> ForceReference:
    """A reference of a fruit that the next load lifts off the table."""
    reference = ForceReference(settings)
    reference.begin(2.2)
    reference.stand((0.0, 0.0))
    return reference


def carrying(coulomb: float = 2.0, share: float = 1.0, **settings: Any) -> ForceReference:
    """A reference that has borne this load for so long that it is at rest."""
    reference = lifted(GripSettings(margin=MARGIN, **settings))
    follow(reference, [load(coulomb, share)] * 3000)
    return reference


def follow(reference: ForceReference, loads: list[GripEstimate], f_n: float = 50.0) -> list[float]:
    """The force that is wanted after each sample, while the fingers press with `f_n` [N]."""
    wanted = []
    for felt in loads:
        reference.follow(felt, f_n, PERIOD)
        wanted.append(reference.wanted)
    return wanted


def test_at_rest_the_margin_is_all_that_is_added() -> None:
    reference = carrying()
    assert reference.is_carried
    assert reference.wanted == pytest.approx(MARGIN * 2.0, rel=1e-6)
    assert reference.f_ref == pytest.approx(MARGIN * 2.0, rel=0.01)


def test_a_share_of_the_moment_that_grows_slowly_is_answered_beyond_the_margin() -> None:
    reference = carrying(share=1.1)
    growing = [load(2.0, share) for share in np.linspace(1.1, 1.5, 500)]
    assert follow(reference, growing)[-1] > 1.1 * MARGIN * growing[-1].f_least


def test_the_answer_fades_when_the_share_grows_no_more() -> None:
    reference = carrying(share=1.1)
    follow(reference, [load(2.0, share) for share in np.linspace(1.1, 1.5, 500)])
    wanted = follow(reference, [load(2.0, 1.5)] * 1500)
    assert wanted[-1] == pytest.approx(MARGIN * 3.0, rel=0.01)


def test_a_share_that_trembles_within_noise_is_not_answered() -> None:
    reference = carrying(share=1.3)
    trembling = 1.3 + 0.05 * np.sin(2.0 * np.pi * 3.0 * PERIOD * np.arange(3000))
    wanted = follow(reference, [load(2.0, share, noise=0.1) for share in trembling])
    assert np.mean(wanted[1000:]) == pytest.approx(MARGIN * 2.6, rel=0.02)


def test_noise_of_light_fruit_costs_no_force() -> None:
    reference = carrying()
    noise = np.random.default_rng(1).normal(0.0, 0.1, 3000)
    wanted = follow(reference, [load(2.0 + error, noise=0.1) for error in noise])
    assert np.mean(wanted[1000:]) == pytest.approx(MARGIN * 2.0, rel=0.02)


def test_a_lift_that_slows_down_hardly_lowers_the_force() -> None:
    reference = carrying()
    assert follow(reference, [load(1.6)] * 125)[-1] > MARGIN * (2.0 - 0.4 * 0.5)
    assert follow(reference, [load(2.0)])[0] > MARGIN * 1.8


def test_a_load_that_rises_counts_at_once() -> None:
    reference = carrying()
    assert follow(reference, [load(3.0, noise=0.02)])[0] > MARGIN * 2.9


def test_a_grip_that_presses_enough_already_is_not_hurried() -> None:
    reference, hurried = carrying(), carrying()
    follow(reference, [load(2.0, rise=0.3)] * 5, f_n=4.0)
    follow(hurried, [load(2.0, rise=0.3)] * 5, f_n=2.2)
    assert reference.f_ref == pytest.approx(MARGIN * 2.0, rel=0.01)
    assert hurried.f_ref > MARGIN * 2.0 + 0.2


def test_a_load_that_twists_is_hurried_all_the_same() -> None:
    reference = carrying(share=2.5)
    before = reference.f_ref
    follow(reference, [load(2.0, share=2.5, rise=0.3)] * 5, f_n=20.0)
    assert reference.f_ref > before + 0.5


def test_the_papers_static_term_is_neither_averaged_nor_hurried() -> None:
    reference = carrying(law=ForceLaw.STATIC)
    assert follow(reference, [load(1.6)])[0] == pytest.approx(MARGIN * 1.6)


def test_a_frozen_reference_never_falls() -> None:
    reference = carrying()
    reference.freeze("because")
    follow(reference, [load(0.5)] * 2000)
    assert reference.f_ref >= MARGIN * 2.0 - 1e-6


def test_fingers_that_contradict_themselves_raise_the_force_to_twice_the_holding_force_at_most() -> (
    None
):
    reference = carrying()
    before = reference.f_ref
    reference.distrust("because")
    follow(reference, [load(20.0)] * 2000)
    assert reference.f_ref == pytest.approx(2.0 * before, rel=1e-6)
    reference.distrust("again")
    follow(reference, [load(20.0)] * 2000)
    assert reference.f_ref == pytest.approx(2.0 * before, rel=1e-6)


def rising(settings: GripSettings, f_t: float) -> float:
    """The largest reference while a load of which a moment twists the fruit rises for 20 ms [N]."""
    reference = lifted(settings)
    highest = 0.0
    for _ in range(10):
        reference.follow(load(2.0, share=1.2, rise=3.0, f_t=f_t), 2.6, PERIOD)
        highest = max(highest, reference.f_ref)
    return highest


def test_a_load_is_not_taken_to_grow_beyond_the_fruits_greatest_weight() -> None:
    unknown, known = GripSettings(margin=MARGIN), GripSettings(margin=MARGIN, expected_load=2.0)
    assert rising(known, f_t=1.5) < rising(unknown, f_t=1.5) - 1.0


def test_a_fruit_heavier_than_expected_from_its_size_is_handled_as_any() -> None:
    unknown, known = GripSettings(margin=MARGIN), GripSettings(margin=MARGIN, expected_load=2.0)
    assert rising(known, f_t=2.1) == rising(unknown, f_t=2.1)


def test_the_force_below_a_standing_fruit_is_no_load_until_it_changes() -> None:
    reference = ForceReference(GripSettings(margin=MARGIN))
    reference.begin(2.2)
    reference.stand((1.5, 0.0))
    pushed = load(4.0, share=1.5, rise=1.0, load=(1.6, 0.1))
    follow(reference, [pushed] * 100)
    assert reference.f_ref == pytest.approx(2.2)
    assert not reference.is_carried
    follow(reference, [load(4.0, share=1.5, rise=1.0, load=(1.9, 0.0))] * 10)
    assert reference.f_ref > 5.0
    follow(reference, [pushed] * 10)  # it hangs, and swings: it does not stand again
    assert reference.f_ref > 5.0


def test_a_fruit_that_is_hit_and_slides_is_pressed_harder_as_long_as_it_slides() -> None:
    reference = carrying()
    before = reference.f_ref
    follow(reference, [load(2.0, push=0.5, f_n=2.2)] * 2)
    first = reference.f_ref
    assert first > 2.0 * before
    assert reference.mode is GripMode.CATCHING
    follow(
        reference, [load(4.0, push=0.5, f_n=4.0)] * 2
    )  # what friction bears grows with the force: it still slides
    assert reference.f_ref > first + 1.0
    follow(reference, [load(2.0, push=0.5, f_n=8.0)] * 10)  # held: nothing is added, nothing let go
    held = reference.f_ref
    assert held == pytest.approx(reference.f_ref)
    follow(reference, [load(2.0, f_n=8.0)] * 2000)
    assert reference.mode is GripMode.CARRIED
    assert reference.f_ref == pytest.approx(MARGIN * 2.0, rel=0.02)


def test_a_hit_at_a_fruit_that_is_held_well_is_not_answered() -> None:
    reference = carrying()
    before = reference.f_ref
    follow(reference, [load(2.0, push=0.5, f_n=4.0)] * 10)
    assert reference.f_ref == pytest.approx(before)


def test_the_reserve_has_a_margin_of_its_own() -> None:
    reference = lifted(GripSettings(margin=1.2))
    follow(reference, [load(2.0, f_reserved=6.0)] * 3000)
    own = GripSettings().reference.reserve_margin
    assert reference.wanted == pytest.approx(1.2 * 2.0 + own * 4.0)


def test_the_modes_follow_each_other_as_drawn() -> None:
    reference = ForceReference(GripSettings(margin=MARGIN))
    assert reference.mode is GripMode.BIAS
    reference.close()
    assert reference.mode is GripMode.CLOSING
    reference.begin(2.2)
    assert reference.mode is GripMode.RAMP
    reference.stand((0.0, 0.0))
    follow(reference, [load(0.2)] * 100)
    assert reference.mode is GripMode.STANDING
    follow(reference, [load(2.0)])
    assert reference.mode is GripMode.LIFTING
    follow(reference, [load(2.0)] * 60)
    assert reference.mode is GripMode.CARRIED
    follow(reference, [load(2.0, push=0.5, f_n=2.2)])
    assert reference.mode is GripMode.CATCHING
    follow(reference, [load(2.0)] * 1000)
    assert reference.mode is GripMode.CARRIED


def test_no_load_counts_as_a_hanging_fruits_before_the_hand_has_risen() -> None:
    reference = lifted(GripSettings(margin=MARGIN))
    reference.stand_until_lifted(True)
    follow(reference, [load(2.0)] * 1000)
    assert reference.mode is GripMode.LIFTING
    reference.stand_until_lifted(False)
    follow(reference, [load(2.0)] * 60)
    assert reference.mode is GripMode.CARRIED


@pytest.mark.parametrize("is_lifted", [True, False])
def test_a_mode_that_a_skill_asked_for_ends_where_it_began(is_lifted: bool) -> None:
    reference = carrying() if is_lifted else lifted(GripSettings())
    before = reference.mode
    reference.slide(0.7)
    follow(reference, [load(2.0)] * 1000)
    assert (reference.mode, reference.f_ref) == (GripMode.SLIDING, pytest.approx(0.7))
    assert reference.is_carried is is_lifted
    reference.slide(None)
    assert reference.mode is before
    assert reference.slide(None)  # nothing to end
    assert reference.mode is before
    reference.fail()
    assert not reference.slide(0.7)
    assert reference.mode is GripMode.FAILED


def test_doubt_about_the_sensors_ends_catching() -> None:
    reference = carrying()
    follow(reference, [load(2.0, push=0.5, f_n=2.2)] * 2)
    reference.freeze("because")
    follow(reference, [load(2.0, push=0.5, f_n=2.2)])
    assert reference.mode is GripMode.CARRIED


def test_every_mode_belongs_to_the_phase_that_records_show() -> None:
    phases = {mode: mode.phase for mode in GripMode}
    assert {mode for mode, phase in phases.items() if phase is GripPhase.HOLDING} == set(HELD)
    assert {phase for mode, phase in phases.items() if mode not in HELD} == set(GripPhase) - {
        GripPhase.HOLDING
    }
