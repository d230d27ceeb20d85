"""The fruit catalogue: models of the kinds of fruit, for Detect, Refine and the grasp."""

from pomona.skills.perception.fruit.catalogue import (
    BadFruitFile,
    FruitError,
    FruitModel,
    Mesh,
    UnknownFruit,
    find_weights,
    known_fruits,
    load_fruit,
)

__all__ = [
    "BadFruitFile",
    "FruitError",
    "FruitModel",
    "Mesh",
    "UnknownFruit",
    "find_weights",
    "known_fruits",
    "load_fruit",
]
