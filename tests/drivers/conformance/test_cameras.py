"""Every camera keeps the claims of cameras, or declares that it cannot."""

from collections.abc import Iterator

import pytest

from pomona.drivers.conformance import camera_claims
from tests.drivers.conformance.cameras import BENCHES, RENDERED

pytestmark = pytest.mark.landmark


@pytest.fixture(autouse=True)
def close_renderers() -> Iterator[None]:
    """Close what a test has opened, in the thread that draws."""
    yield
    while RENDERED:
        RENDERED.pop().close()


test_claims = camera_claims(**BENCHES)
