"""Creep of a held fruit in MuJoCo follows the rows of its contacts."""

import pytest

from benchmarks.grasp_creep import Options, creep


@pytest.mark.parametrize(
    "options", [Options(impratio=1.0), Options(), Options(impratio=10.0, timeconst=0.02)]
)
def test_velocity_is_the_closed_form(options: Options) -> None:
    simulated, expected = creep(options, mass=0.2, mu=0.6, ratio=1.5)

    assert simulated > 0.0
    assert simulated == pytest.approx(expected, rel=0.02)


def test_grip_force_and_friction_change_little() -> None:
    weak, strong = (
        creep(Options(impratio=10.0), 0.2, mu, ratio)[0] for mu, ratio in ((0.3, 1.2), (0.9, 3.0))
    )

    assert strong == pytest.approx(weak, rel=0.4)


def test_impratio_divides_it() -> None:
    soft, hard = (creep(Options(impratio=ratio), 0.2, 0.6, 1.5)[0] for ratio in (1.0, 100.0))

    assert soft == pytest.approx(100.0 * hard, rel=0.05)
