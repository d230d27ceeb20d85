"""Pads of a mock hand for the tests of skills that grip."""

from pomona.drivers.pads import FingerPads, PadOptions


def finger_pads(mu: float = 0.75, uncertainty: float = 0.1) -> FingerPads:
    """Soft pads with this friction on all fruit."""
    friction = {"any": (mu * (1.0 - uncertainty), mu * (1.0 + uncertainty))}
    options = PadOptions(
        friction=friction, delta=4.353e-3, gamma=0.2569, stiffness=2000.0, measured="assumed"
    )
    return FingerPads("pads", options)
