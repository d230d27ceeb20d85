"""Which class of a data set or a model is the fruit."""

from __future__ import annotations

import pytest

from pomona.skills.perception.detection.class_names import ClassUnknown, class_of


@pytest.mark.parametrize(
    ("names", "number"),
    [
        (["apple"], 0),
        (["pineapple", "apple"], 1),
        (["rotten apple", "apple"], 1),
        (["leaf", "Apple"], 1),
        (["leaf", "red_apple"], 1),
        (["leaf", "GreenApple2"], 1),
        (["leaf", "apples"], 1),
        (["apples", "apple-detection-v3"], 0),
        (["apples", "apple"], 1),
        (["Apple", "apple"], 1),
        (["Apfel", "apple (fruit)"], 1),
    ],
)
def test_the_class_is_the_one_of_the_fruits_name_else_the_one_that_has_it_as_a_word(
    names: list[str], number: int
) -> None:
    assert class_of(dict(enumerate(names)), "apple") == number


@pytest.mark.parametrize(
    "names", [["pineapple"], ["pineapple", "pear"], ["grapple"], ["appletree"], ["custardapple"], []]
)
def test_a_part_of_a_word_is_no_fruit(names: list[str]) -> None:
    with pytest.raises(ClassUnknown, match="none of them is apple"):
        class_of(dict(enumerate(names)), "apple")


def test_several_that_could_be_the_fruit_are_refused() -> None:
    for names in (["red apple", "green apple"], ["Apple", "APPLE"], ["Apples", "APPLES"]):
        with pytest.raises(ClassUnknown, match="2 of them could be apple"):
            class_of(dict(enumerate(names)), "apple")


@pytest.mark.parametrize(
    ("fruit", "name"), [("cherry tomato", "Cherry-Tomatoes"), ("peach", "peaches"), ("berry", "berries")]
)
def test_fruit_of_two_words_and_plurals_are_words(fruit: str, name: str) -> None:
    assert class_of({0: "other", 1: name, 2: "tomato sauce"}, fruit) == 1
