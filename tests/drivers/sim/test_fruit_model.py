"""The simulation reads the fruit files of the skills."""

import pytest

from pomona.drivers.sim.fruit_model import read_model
from pomona.skills.perception.fruit import known_fruits
from pomona.skills.perception.fruit.catalogue import CATALOGUE


@pytest.mark.parametrize("name", known_fruits())
def test_a_shipped_fruit_file_with_all_its_settings_is_read(name: str) -> None:
    vertices, faces = read_model(CATALOGUE / name).flesh
    assert len(vertices) > 100
    assert faces.max() < len(vertices)
