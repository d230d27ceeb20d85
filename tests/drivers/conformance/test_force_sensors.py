"""Every force sensor keeps the claims of force sensors, or declares that it cannot."""

import pytest

from pomona.drivers.conformance import force_sensor_claims
from tests.drivers.conformance.force_sensors import BENCHES

pytestmark = pytest.mark.landmark

test_claims = force_sensor_claims(**BENCHES)
