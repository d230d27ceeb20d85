"""A fruit.yaml has two readers: the skills, and the simulated world, which reads the meshes."""

from dataclasses import fields
from pathlib import Path

import pytest

from pomona.executive.values.installation import installed_trees
from pomona.skills.perception.fruit.catalogue import FruitFileSection
from pomona.tools.simulation.fruit_shape import OF_PERCEPTION, UnusableModel, read_model


def test_each_key_that_the_skills_read_is_known_to_the_simulated_world() -> None:
    assert {field.name for field in fields(FruitFileSection)} == {
        "mesh",
        "stem",
        "pressure",
        *OF_PERCEPTION,
    }


@pytest.mark.parametrize(
    "kind", sorted(path.parent.name for path in (installed_trees() / "fruits").glob("*/fruit.yaml"))
)
def test_each_shipped_fruit_has_meshes(kind: str) -> None:
    assert len(read_model(installed_trees() / "fruits" / kind).flesh[1]) > 100


def test_an_unknown_key_is_named_with_its_place(tmp_path: Path) -> None:
    (tmp_path / "fruit.yaml").write_text("name: pear\nmesh: none.obj\nwieght: 3\n")
    with pytest.raises(UnusableModel, match=r"fruit\.yaml:[23]:"):
        read_model(tmp_path)
