"""The circle of a 2F's fingertips: its ends, its tangent, and widths that no gripper has."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.devices.robotiq.linkage import LINKAGES
from pomona.devices.robotiq.options import MODELS
from pomona.executive.values.installation import installed_trees

ROBOT = installed_trees() / "robots" / "ur5e_2f85.xml"
models, shares = st.sampled_from(sorted(LINKAGES)), st.floats(0.0, 1.0)


@given(models, shares, shares)
def test_a_fingertip_stays_on_its_circle_and_goes_forward_as_it_closes(
    model: str, one: float, other: float
) -> None:
    linkage = LINKAGES[model]
    centre = -linkage.width_max / 2.0 + linkage.crank * np.cos(linkage.open_angle)
    at = []
    for share in sorted((one, other)):
        width = share * linkage.width_max
        across = width / 2.0 + centre
        up = linkage.forward(width) + linkage.crank * np.sin(linkage.open_angle)
        at.append(up)
        assert np.hypot(across, up) == pytest.approx(linkage.crank, abs=1e-9)
    # beyond the crank's highest point, in the last 11 mm, they go back by a third of a millimetre at most
    assert at[0] >= at[1] - 3.3e-4


@given(models, st.floats(0.02, 0.98))
def test_the_axis_is_the_direction_in_which_the_fingertip_moves(model: str, share: float) -> None:
    linkage, step = LINKAGES[model], 1e-6
    width = share * linkage.width_max
    across, along = linkage.slide_axis(width)
    slope = (
        linkage.forward(width + step) - linkage.forward(width - step)
    ) / step  # a finger moves half of the width
    assert along / across == pytest.approx(slope, abs=1e-5)
    assert np.hypot(across, along) == pytest.approx(1.0)


def test_the_pads_of_the_described_2f_85_go_on_its_circle() -> None:
    model = mujoco.MjModel.from_xml_path(str(ROBOT))
    data, linkage = mujoco.MjData(model), LINKAGES["2f-85"]
    for side, across in (("left", 1.0), ("right", -1.0)):
        finger, curve = (model.joint(f"{name}_{side}") for name in ("finger", "curve"))
        for q in np.linspace(*finger.range, 20):
            data.qpos[finger.qposadr], data.qpos[curve.qposadr] = (
                q,
                np.polyval(model.eq(curve.name).data[4::-1], q),
            )
            mujoco.mj_kinematics(model, data)
            T = data.body("tool0")
            _, y, z = T.xmat.reshape(3, 3).T @ (data.site(f"pad_{side}").xpos - T.xpos)
            width = min(max(2.0 * across * y, 0.0), linkage.width_max)
            assert 2.0 * across * y == pytest.approx(width, abs=1e-6)
            assert z == pytest.approx(0.1481 + linkage.forward(width), abs=1e-4)
    assert width == pytest.approx(linkage.width_max, abs=1e-6)


@given(models, st.floats(0.03, 0.07), st.floats(-0.015, 0.015))
def test_near_its_width_the_line_is_off_by_little(model: str, width: float, beside: float) -> None:
    linkage = LINKAGES[model]
    across, along = linkage.slide_axis(width)
    off = linkage.forward(width + beside) - linkage.forward(width) - along / across * beside / 2.0
    assert abs(off) < 1.2e-3


@pytest.mark.parametrize(("model", "forward"), [("2f-85", 13.9e-3), ("2f-140", 23.6e-3)])
def test_the_ends_are_those_of_the_model(model: str, forward: float) -> None:
    linkage = LINKAGES[model]
    assert linkage.width_max == MODELS[model].stroke
    assert linkage.forward(linkage.width_max) == pytest.approx(0.0, abs=1e-12)
    assert linkage.forward(0.0) == pytest.approx(forward, abs=1e-4)


@pytest.mark.parametrize("width", [-1e-3, 0.2, np.nan])
def test_a_width_that_the_gripper_does_not_have_is_refused(width: float) -> None:
    with pytest.raises(ValueError, match=r"is none of 0 to 85 mm"):
        LINKAGES["2f-85"].angle(width)
