"""Changes between two versions of a tree are described in words."""

from __future__ import annotations

import pytest

from pomona.executive.language import read
from pomona.tools.editor.compare import changes


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("default: 12,", "default: 20,", ["parameter attempts: int, default 12, min 1 → int, default 20, min 1"]),
        ("200 ms", "300 ms", ["tree pick_apple: Attempt/fallback/Plan budget: 200 ms → 300 ms"]),
        ("timeout: 5 s", "timeout: 6 s", ["subtree perceive: Detect timeout: 5 s → 6 s"]),
        ("          timeout: 5 s\n", "", ["subtree perceive: Detect timeout is gone"]),
        ("# before the next try", "# afterwards", []),
        ("in:  {fruit: text}", "in: {fruit: text, far: length}", ["subtree perceive: input far: length (new)"]),
        ("        - Approach:", "        - Beep: {}\n        - Approach:", ["tree pick_apple: Attempt/Beep is new"]),
        ("Retreat: {}", "Beep: {}", ["tree pick_apple: Attempt:on_failure type: Retreat → Beep"]),
    ],
)
def test_changes(pick_apple, old, new, told):
    assert old in pick_apple
    before, after = read(pick_apple, "t.yaml"), read(pick_apple.replace(old, new), "t.yaml")
    assert changes(before, after) == told


def test_another_order():
    head = "pomona: 1\ntree: t\nroot: {sequence: ["
    before, after = read(head + "{A: {}}, {B: {}}]}", "t"), read(head + "{B: {}}, {A: {}}]}", "t")
    assert changes(before, after) == ["tree t: nodes are in another order"]
