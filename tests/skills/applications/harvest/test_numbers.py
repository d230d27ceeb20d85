import pytest

from pomona.applications.harvest.numbers import read_numbers
from pomona.drivers.errors import CellFileError

from .conftest import NUMBERS

FROZEN = "037cf4fb8ac24e0c"
"""Digest of the numbers that the skills are tuned for. Change it only with a new comparison with the measured pulls in
docs/evidence.
"""


def test_the_numbers_are_those_that_were_frozen(numbers):
    assert numbers.digest() == FROZEN


def test_every_number_names_its_source():
    _, origins = read_numbers(NUMBERS)
    assert all(len(origin.source) > 8 for origin in origins.values())
    assert {origin.standing for origin in origins.values()} == {"measured", "derived", "assumed"}


def test_a_wrong_unit_is_refused_at_its_place(tmp_path):
    path = tmp_path / "wall.yaml"
    path.write_text(
        NUMBERS.read_text().replace("pull_median: {value: 20 N,", "pull_median: {value: 20 kg,")
    )
    with pytest.raises(CellFileError, match=r"pull_median.*'kg'"):
        read_numbers(path)


def test_a_number_without_a_source_is_refused(tmp_path):
    path = tmp_path / "wall.yaml"
    path.write_text(
        NUMBERS.read_text().replace(
            "pull_sigma: {value: 0.32, source:", "pull_sigma: {value: 0.32, note:"
        )
    )
    with pytest.raises(CellFileError, match="source"):
        read_numbers(path)


def test_scaling_changes_one_number_and_the_digest(numbers):
    scaled = numbers.scaled("spur_length", 0.5)
    assert scaled.spur_length == tuple(0.5 * end for end in numbers.spur_length)
    assert scaled.digest() != numbers.digest()
    assert scaled.scaled("spur_length", 2.0).digest() == numbers.digest()
