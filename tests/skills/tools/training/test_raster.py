"""Which side of a triangle looks at the camera."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, strategies as st

from pomona.skills.perception.rasteriser import project
from pomona.tools.training.raster import signed_areas

CORNER = st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.3, 2.0))


@given(st.tuples(CORNER, CORNER, CORNER))
def test_an_area_is_negative_where_the_outside_is_seen(corners: tuple) -> None:
    points = np.array(corners)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    assume(abs(normal @ points[0]) > 1e-6)
    u, v, _ = project(points, (600.0, 600.0, 320.0, 240.0))
    (area,) = signed_areas(u, v, np.array([[0, 1, 2]], np.int32))
    assert (area < 0.0) == (normal @ points[0] < 0.0)
