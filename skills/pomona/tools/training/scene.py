"""Random scenes with fruit: a picking table, randomised clutter, an orchard, a tree; rendered with exact labels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training import textures
from pomona.tools.training.composition import compose
from pomona.tools.training.contents import SyntheticScene
from pomona.tools.training.options import SceneKind, SceneOptions
from pomona.tools.training.raster import Lighting, Surfaces, TablePlane, Visible, rasterise, shade
from pomona.tools.training.surroundings import cast_shadow, draw_backdrop, lay_table, set_lights
from pomona.tools.training.truth import FruitTruth, decoy_circle, true_fruit


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """A picture (h, w, 3) uint8 RGB, z-depth (h, w) float32 [m], and the truth about its fruit and its decoys."""

    colour: NDArray[np.uint8]
    depth: Float32
    fruit: tuple[FruitTruth, ...]
    decoys: tuple[tuple[float, float, float], ...]
    kind: SceneKind


def render_scene(fruit: FruitModel, options: SceneOptions, seed: int) -> RenderedFrame:
    """Compose and render the scene of a seed; the same seed and options give the same frame."""
    rng = np.random.default_rng((23, seed))
    kind = list(SceneKind)[
        rng.choice(len(SceneKind), p=np.asarray(options.kinds) / sum(options.kinds))
    ]
    scene = compose(fruit, options, kind, rng)
    return _render(fruit, options, scene, rng)


def _render(
    fruit: FruitModel, options: SceneOptions, scene: SyntheticScene, rng: np.random.Generator
) -> RenderedFrame:
    h = options.height
    w = options.width
    T_wc = scene.T_world_camera
    R_cw = T_wc[:3, :3].T
    eye = T_wc[:3, 3]
    points = []
    normals = []
    albedo = []
    grain = []
    openness = []
    faces = []
    face_object = []
    start = 0
    for k, item in enumerate(scene.items):
        local = item.shape.vertices * item.scale.astype(np.float32)
        R = (R_cw @ item.rotation).astype(np.float32)
        points.append(local @ R.T + (R_cw @ (item.centre - eye)).astype(np.float32))
        bent = (item.shape.normals / item.scale.astype(np.float32)) @ R.T
        normals.append(bent / (np.linalg.norm(bent, axis=1, keepdims=True) + np.float32(1e-12)))
        albedo.append(item.albedo)
        grain.append((local + np.float32(0.37 * (k + 1))) * np.float32(item.grain_frequency))
        openness.append(1.0 - item.openness * (1.0 - item.shape.openness))
        faces.append(item.shape.faces + start)
        face_object.append(np.full(len(item.shape.faces), k, np.int32))
        start += len(local)
    P = np.ascontiguousarray(np.concatenate(points), np.float32)
    F = np.ascontiguousarray(np.concatenate(faces), np.int32)
    owner_of_face = np.concatenate(face_object)
    camera = np.asarray(options.camera, np.float32)
    two_sided = np.array([item.shape.two_sided for item in scene.items])
    depth, face_index, weights = rasterise(P, F, owner_of_face, two_sided, camera, (h, w))

    picture = draw_backdrop(fruit, options, scene, rng)
    owner = np.empty((h, w), np.int32)
    lights, up, ambient = set_lights(scene, R_cw, rng)
    shadow, light_map = cast_shadow(P, F, lights[0, :3], rng)
    plane, plane_axes, plane_look = lay_table(scene, T_wc, rng)
    spheres = np.array([[*(R_cw @ (c - eye)), r] for c, r in scene.spheres], np.float32).reshape(
        -1, 4
    )
    looks = [
        np.ascontiguousarray(np.concatenate(each), np.float32)
        for each in (normals, albedo, grain, openness)
    ]
    material = np.array([item.material for item in scene.items], np.float32)
    surfaces = Surfaces(looks[0], looks[1], looks[2], looks[3], F, owner_of_face, material)
    darkening = spheres if rng.random() < 0.8 else spheres[:0]
    strength = float(rng.uniform(0.4, 1.0) if rng.random() < 0.75 else 0.0)
    shade(
        surfaces,
        Visible(camera, depth, face_index, weights),
        TablePlane(
            plane, plane_axes, plane_look, darkening, textures.table_top(int(rng.integers(0, 96)))
        ),
        Lighting(lights, up, ambient, light_map, shadow, strength),
        textures.grain(),
        picture,
        owner,
    )
    fruit_truths = true_fruit(fruit, options, scene, owner, P, F, owner_of_face)
    colour = photograph(picture, rng)
    decoys = tuple(decoy_circle(options, R_cw @ (c - eye), r) for c, r in scene.decoys)
    return RenderedFrame(colour, depth, fruit_truths, decoys, scene.kind)


def photograph(picture: Float32, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Linear RGB (h, w, 3) as a camera gives it: exposure, lens blur, gamma, shot and read noise, quantisation."""
    h, w = picture.shape[:2]
    bright = float(np.percentile(picture[::8, ::8], 90.0)) + 1e-3
    exposure = rng.uniform(0.55, 1.35) / bright if rng.random() < 0.8 else rng.uniform(0.6, 1.5)
    picture = np.clip(picture * np.float32(exposure), 0.0, 1.6)
    if rng.random() < 0.85:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.35, 1.1))
    if rng.random() < 0.08:
        length = int(rng.integers(2, 5))
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
        angle = rng.uniform(0.0, np.pi)
        for s in np.linspace(-length, length, 6 * length):
            kernel[round(length + s * np.sin(angle)), round(length + s * np.cos(angle))] += 1.0
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    coded = (
        np.sqrt(np.clip(picture, 0.0, 1.0))
        if rng.random() < 0.75
        else np.clip(picture, 0.0, 1.0) ** rng.uniform(0.4, 1.0)
    )
    if rng.random() < 0.8:
        level = rng.uniform(0.002, 0.03) * rng.uniform(0.2, 1.0)
        noise = textures.sensor_noise()
        for c in range(3):
            y = rng.integers(0, noise.shape[0] - h)
            x = rng.integers(0, noise.shape[1] - w)
            coded[..., c] += np.float32(level) * noise[y : y + h, x : x + w]
    return (np.clip(coded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
