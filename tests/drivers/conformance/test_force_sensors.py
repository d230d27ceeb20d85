"""Every force sensor keeps the claims of force sensors, or declares that it cannot."""

import inspect

import pytest

from pomona.devices.emulators import suntouch
from pomona.drivers.conformance import force_sensor_claims
from tests.drivers.conformance.force_sensors import BENCHES

pytestmark = pytest.mark.landmark

test_claims = force_sensor_claims(**BENCHES)


def test_an_emulated_finger_imports_nothing_of_the_driver_that_it_judges() -> None:
    assert "pomona.devices.suntouch" not in inspect.getsource(suntouch)
