import numpy as np
import pytest

from pomona.drivers.emulators.suntouch import Pad
from pomona.drivers.suntouch.spike_filter import JUMP, SpikeFilter


def test_a_single_jump_of_one_taxel_is_rejected() -> None:
    spikes, rest, spike = SpikeFilter(), np.full(25, 1.5), np.full(25, 1.5)
    spike[3] += 0.06
    assert [spikes.accept(volts) for volts in (rest, rest, spike, rest)] == [True, True, False, True]
    assert spikes.rejected == 1


def test_a_lasting_step_of_one_taxel_is_believed_one_reading_late() -> None:
    spikes, rest, pressed = SpikeFilter(), np.full(25, 1.5), np.full(25, 1.5)
    pressed[3] = 1.8
    assert [spikes.accept(volts) for volts in (rest, pressed, pressed, pressed)] == [True, False, True, True]


def test_a_slow_change_is_no_spike_however_far_it_goes() -> None:
    spikes = SpikeFilter()
    assert all(spikes.accept(np.full(25, volts)) for volts in np.arange(1.0, 2.0, 0.049))


def test_after_a_gap_the_first_reading_is_believed() -> None:
    spikes = SpikeFilter()
    spikes.accept(np.full(25, 1.0))
    spikes.forget()
    assert spikes.accept(np.full(25, 2.0))


@pytest.mark.parametrize("place", [0.0, 0.008])
def test_a_contact_that_breaks_moves_the_taxels_around_it_and_is_no_spike(place: float) -> None:
    for seed in range(20):
        pad, spikes = Pad(seed), SpikeFilter()
        pressed = np.array([0.3, 0.0, -2.0, -2.0 * place, 2.0 * place, 0.0])
        volts = [pad.volts(share * pressed) for share in (1.0, 0.0, 1.35, 1.0)]
        assert np.abs(volts[1] - volts[0]).max() > JUMP
        assert all(spikes.accept(each) for each in volts)


def test_a_row_of_taxels_that_jumps_alone_is_rejected() -> None:
    spikes, rest = SpikeFilter(), np.full(25, 1.5)
    row = rest.copy()
    row[5:10] += 0.2
    assert [spikes.accept(volts) for volts in (rest, row, rest)] == [True, False, True]
