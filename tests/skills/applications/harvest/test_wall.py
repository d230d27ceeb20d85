import numpy as np
import pytest

from pomona.applications.harvest.wall import _beside, draw_wall


@pytest.mark.parametrize("seed", range(6))
def test_nothing_that_is_drawn_overlaps_a_fruit(numbers, seed):
    wall = draw_wall(numbers, seed, fruit=24, leaves=0.2)
    assert len(wall.fruits) == 24
    for i, fruit in enumerate(wall.fruits):
        p = fruit.T_base_fruit[:3, 3]
        for other in wall.fruits[:i]:
            assert np.linalg.norm(p - other.T_base_fruit[:3, 3]) > fruit.radius + other.radius
        for lateral in wall.laterals:
            end = lateral.start + lateral.length * lateral.direction
            assert _beside(p, lateral.start, end, max(lateral.diameters) / 2.0) > fruit.radius
        for spur in wall.spurs:
            assert _beside(p, spur.start, spur.tip, spur.diameter / 2.0) > fruit.radius
        for leaf in wall.leaves:
            middle = leaf.start + (leaf.petiole + leaf.length / 2.0) * leaf.R_base_leaf[:, 0]
            assert np.linalg.norm(middle - p) > fruit.radius


def test_a_wall_holds_the_stated_numbers_of_parts(numbers):
    walls = [draw_wall(numbers, seed, leaves=0.0) for seed in range(8)]
    counts = [len(wall.fruits) for wall in walls]
    assert min(counts) >= numbers.fruit_count[0]
    assert max(counts) <= numbers.fruit_count[1]
    assert len(set(counts)) > 4
    clusters = [fruit.cluster for wall in walls for fruit in wall.fruits]
    assert set(clusters) == {1, 2, 3}
    for wall in walls:
        for fruit in wall.fruits:
            assert np.allclose(fruit.T_base_fruit[:3, :3].T @ fruit.T_base_fruit[:3, :3], np.eye(3))
            assert np.linalg.det(fruit.T_base_fruit[:3, :3]) > 0.0
            assert fruit.T_base_fruit[2, 1] < -0.2  # hangs below where its stem sits


def test_leaves_change_neither_wood_nor_fruit(numbers):
    bare, full = (draw_wall(numbers, 3, leaves=share) for share in (0.0, 1.0))
    half = draw_wall(numbers, 3, leaves=0.5)
    assert bare.leaves == ()
    assert 0.35 < len(half.leaves) / len(full.leaves) < 0.65
    for a, b in zip(bare.fruits, full.fruits, strict=True):
        assert np.array_equal(a.T_base_fruit, b.T_base_fruit)
        assert a.strength == b.strength
    assert all(
        np.array_equal(a.direction, b.direction)
        for a, b in zip(bare.laterals, full.laterals, strict=True)
    )


def test_a_seed_draws_the_same_wall_again(numbers):
    first, second = (draw_wall(numbers, 5, fruit=10) for _ in range(2))
    assert [f.strength for f in first.fruits] == [f.strength for f in second.fruits]
    assert np.array_equal(first.leaves[-1].R_base_leaf, second.leaves[-1].R_base_leaf)


def test_a_crowded_wall_holds_as_many_fruit_as_fit(numbers):
    assert len(draw_wall(numbers, 0, fruit=1, leaves=0.0).fruits) == 1
    crowded = draw_wall(numbers, 0, fruit=60, leaves=0.0)
    assert 30 < len(crowded.fruits) <= 60


def test_a_base_that_stands_elsewhere_sees_the_same_wall_shifted(numbers):
    usual = draw_wall(numbers, 3, leaves=0.3)
    seen = usual.seen_from(0.35, 0.2)
    by = np.array([-0.35, 0.0, -0.2])
    for a, b in zip(usual.fruits, seen.fruits, strict=True):
        assert np.allclose(b.T_base_fruit[:3, 3] - a.T_base_fruit[:3, 3], by)
        assert np.allclose(b.anchor - a.anchor, by)
        assert np.array_equal(a.T_base_fruit[:3, :3], b.T_base_fruit[:3, :3])
    for kind in ("laterals", "spurs", "leaves"):
        for a, b in zip(getattr(usual, kind), getattr(seen, kind), strict=True):
            assert np.allclose(b.start - a.start, by)
    assert seen.trunk[0] - usual.trunk[0] == pytest.approx(-0.35)
    assert seen.wires[0].z - usual.wires[0].z == pytest.approx(-0.2)
    assert (seen.ground - usual.ground, seen.trunk_top - usual.trunk_top) == pytest.approx(
        (-0.2, -0.2)
    )


def test_fruit_that_is_taken_away_changes_nothing_of_the_rest(numbers):
    wall = draw_wall(numbers, 3, leaves=0.3)
    rest = wall.without({0, 4})
    assert [each.number for each in wall.fruits] == list(range(len(wall.fruits)))
    assert rest.fruits == tuple(each for each in wall.fruits if each.number not in (0, 4))
    assert (rest.spurs, rest.laterals, rest.leaves, rest.wires) == (
        wall.spurs,
        wall.laterals,
        wall.leaves,
        wall.wires,
    )
    assert rest.numbers.digest() == wall.numbers.digest()
