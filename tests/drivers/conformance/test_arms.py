"""Every arm keeps the claims of arms, or declares that it cannot."""

from __future__ import annotations

import pytest

from pomona.drivers.conformance import arm_claims
from tests.drivers.conformance.arms import BENCHES

pytestmark = pytest.mark.landmark

test_claims = arm_claims(**BENCHES)
