import numpy as np

from pomona.devices.suntouch.finger import SpikeFilter


def test_a_single_jump_of_one_taxel_is_rejected() -> None:
    spikes, rest, spike = SpikeFilter(), np.full(25, 1.5), np.full(25, 1.5)
    spike[3] += 0.06
    assert [spikes.accept(volts) for volts in (rest, rest, spike, rest)] == [
        True,
        True,
        False,
        True,
    ]
    assert spikes.rejected == 1


def test_a_lasting_step_is_accepted_one_reading_late() -> None:
    spikes, rest, pressed = SpikeFilter(), np.full(25, 1.5), np.full(25, 1.8)
    assert [spikes.accept(volts) for volts in (rest, pressed, pressed, pressed)] == [
        True,
        False,
        True,
        True,
    ]


def test_a_slow_change_is_no_spike_however_far_it_goes() -> None:
    spikes = SpikeFilter()
    assert all(spikes.accept(np.full(25, volts)) for volts in np.arange(1.0, 2.0, 0.049))


def test_after_a_gap_the_first_reading_is_accepted() -> None:
    spikes = SpikeFilter()
    spikes.accept(np.full(25, 1.0))
    spikes.forget()
    assert spikes.accept(np.full(25, 2.0))
