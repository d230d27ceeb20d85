"""Error models of depth: against their formulas, and their files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pomona.drivers.depth_model import (
    AZURE_KINECT,
    D4XX,
    SENSORS,
    SIMULATED,
    DepthModel,
    DepthModelSection,
    depth_model_of,
)
from pomona.drivers.errors import CellFileError
from pomona.executive.cell.registration import read_section_file
from pomona.executive.values.sections import Section

Z = np.array([0.3, 0.6, 1.2])


def test_stereo_depth_errs_by_disparity_over_focal_length_and_baseline_and_by_the_floor() -> None:
    stereo = DepthModel(disparity=0.1, baseline=0.05).deviation(Z, 600.0)
    assert stereo == pytest.approx(Z**2 * 0.1 / (600.0 * 0.05))
    both = DepthModel(disparity=0.1, baseline=0.05, floor=2e-3).deviation(Z, 600.0)
    assert both == pytest.approx(np.sqrt(stereo**2 + 4e-6))


def test_time_of_flight_errs_by_the_square_of_the_distance_whatever_the_focal_length() -> None:
    model = DepthModel(growth=1e-3)
    assert model.deviation(Z, 600.0) == pytest.approx(1e-3 * Z**2)
    assert model.deviation(Z, 900.0) == pytest.approx(1e-3 * Z**2)


def test_what_all_pixels_have_in_common_is_the_scale_and_the_offset_over_the_depth() -> None:
    model = DepthModel(disparity=0.08, baseline=0.05, scale_deviation=0.003, offset_deviation=0.008)
    assert model.of_the_whole(2.0) == pytest.approx(0.005)
    assert model.of_the_whole(0.5) == pytest.approx(np.hypot(0.003, 0.016))


def test_the_area_of_a_pixel_grows_with_the_distance_and_so_does_the_error_of_a_width() -> None:
    """A pixel of 5.3 mm cannot give a width to 2 mm."""
    far, pixel = 4.9, 5.3e-3
    assert D4XX.outline(far, far / pixel) > 4e-3
    assert D4XX.outline(far, far / pixel) == pytest.approx(10.0 * D4XX.outline(0.49, far / pixel))
    assert SIMULATED.outline(far, far / pixel) == pytest.approx(np.sqrt(2.0 / 12.0) * pixel)


def test_a_registration_that_is_off_lets_depth_differ_where_a_surface_is_turned_away() -> None:
    beside = replace(SIMULATED, registration=5.0)
    assert SIMULATED.agreeing(Z, 600.0) == pytest.approx(SIMULATED.deviation(Z, 600.0))
    moved = np.tan(np.radians(30.0)) * 5.0 * Z / 600.0
    assert beside.agreeing(Z, 600.0) == pytest.approx(
        np.hypot(SIMULATED.deviation(Z, 600.0), moved)
    )


def test_corrected_depth_is_the_true_one_and_holes_stay_holes() -> None:
    true = np.array([[0.0, 0.5, 1.5]], np.float32)
    model = replace(SIMULATED, offset=0.01, scale=0.02)
    measured = np.where(true > 0.0, 0.01 + 1.02 * true, 0.0).astype(np.float32)
    assert model.corrected(measured) == pytest.approx(true, abs=1e-6)
    assert SIMULATED.corrected(measured) is measured


def read(file: Path) -> DepthModel:
    section = Section(DepthModelSection)
    return read_section_file(
        file, "a depth model", lambda given: section.read(given.root, given.reader).model()
    )


def test_a_file_names_a_sensor_and_its_better_known_values(tmp_path: Path) -> None:
    file = tmp_path / "depth_model.yaml"
    file.write_text("sensor: azure_kinect\ngrowth: 1 mm\nscale: 0.01\nedge: 3 px\n")
    assert read(file) == replace(AZURE_KINECT, growth=1e-3, scale=0.01, edge=3)
    assert depth_model_of(None) == D4XX
    assert depth_model_of(DepthModelSection(sensor="simulated")) == SIMULATED


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("sensor: azure", "azure_kinect"),
        ("sensor: simulated\ndisparity: 0 px", "without noise"),
        ("scale: 0.9", "scale"),
        ("offset: 3", "offset"),
        ("- 1", "mapping"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_its_place(
    tmp_path: Path, text: str, says: str
) -> None:
    file = tmp_path / "depth_model.yaml"
    file.write_text(text + "\n")
    with pytest.raises(CellFileError, match=says) as refused:
        read(file)
    assert f"{file}:" in str(refused.value)


def test_every_shipped_sensor_has_noise() -> None:
    for model in SENSORS.values():
        assert (model.deviation(Z, 600.0) > 0.0).all()
