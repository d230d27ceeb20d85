"""Every driver of signals keeps the claims of signals, or declares that it cannot."""

import pytest

from pomona.drivers.conformance import signals_claims
from tests.drivers.conformance.signals import BENCHES

pytestmark = pytest.mark.landmark

test_claims = signals_claims(**BENCHES)
