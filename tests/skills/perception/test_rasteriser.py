"""The one loop that draws triangles, against rays that are intersected with every triangle."""

import numpy as np

from pomona.skills.perception.rasteriser import draw, project

CAMERA = (60.0, 55.0, 15.3, 11.8)
SHAPE = (24, 32)


def triangles(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    points = rng.uniform((-0.15, -0.12, 0.4), (0.15, 0.12, 0.9), (3 * count, 3))
    return points, np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def by_rays(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth, face and shares of its first two corners where the ray of each pixel first meets a triangle."""
    depth, index, shares = np.full(SHAPE, np.inf), np.full(SHAPE, -1), np.zeros((*SHAPE, 2))
    fx, fy, cx, cy = CAMERA
    for v in range(SHAPE[0]):
        for u in range(SHAPE[1]):
            ray = np.array([(u - cx) / fx, (v - cy) / fy, 1.0])
            for k, face in enumerate(faces):
                a, b, c = points[face]
                z, share_b, share_c = np.linalg.solve(np.column_stack([ray, a - b, a - c]), a)
                if min(share_b, share_c, 1.0 - share_b - share_c) >= 0.0 and 0.0 < z < depth[v, u]:
                    depth[v, u], index[v, u], shares[v, u] = (
                        z,
                        k,
                        (1.0 - share_b - share_c, share_b),
                    )
    return depth, index, shares


def visible_sides(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    normals = np.cross(
        points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    )
    return (normals * points[faces[:, 0]]).sum(axis=1) < 0.0


def test_every_pixel_shows_the_first_surface_on_its_ray() -> None:
    points, faces = triangles(0, 12)
    depth, index, shares = by_rays(points, faces)
    nearest, shown, parts = (
        np.zeros(SHAPE),
        np.full(SHAPE, -1, np.int32),
        np.zeros((*SHAPE, 2), np.float32),
    )
    u, v, nearness = project(points, CAMERA)
    draw(u, v, nearness, faces, np.ones(len(faces), np.bool_), nearest, shown, parts)
    assert (index >= 0).sum() > 100
    assert np.array_equal(shown, index)
    assert np.allclose(1.0 / nearest[index >= 0], depth[index >= 0], rtol=1e-9)
    assert np.allclose(parts, shares, atol=1e-6)


def test_triangles_that_are_left_out_are_not_drawn() -> None:
    points, faces = triangles(1, 8)
    u, v, nearness = project(points, CAMERA)
    towards = visible_sides(points, faces)
    nearest, shown = np.zeros(SHAPE), np.full(SHAPE, -1, np.int32)
    draw(u, v, nearness, faces, towards, nearest, shown)
    assert set(shown[shown >= 0].tolist()) <= set(np.flatnonzero(towards).tolist())
    assert np.array_equal(by_rays(points, faces[towards])[1] >= 0, shown >= 0)


def test_neighbours_leave_no_crack_and_triangles_outside_the_picture_draw_nothing() -> None:
    corners = np.array([[-1.0, -1.0, 0.5], [1.0, -1.0, 0.5], [1.0, 1.0, 0.5], [-1.0, 1.0, 0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    nearest = np.zeros(SHAPE)
    draw(*project(corners, CAMERA), faces, np.ones(2, np.bool_), nearest)
    assert np.allclose(nearest, 2.0)
    nearest = np.zeros(SHAPE)
    draw(
        *project(corners + np.array([9.0, 0.0, 0.0]), CAMERA), faces, np.ones(2, np.bool_), nearest
    )
    assert not nearest.any()
