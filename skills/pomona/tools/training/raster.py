"""A small software renderer: visible surfaces, shadow map and shading, without OpenGL."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, Int32
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.perception.rasteriser import draw, project

NEAR = 0.03  # faces closer to the camera than this are dropped [m]


def signed_areas(u: Float64, v: Float64, faces: Int32) -> Float64:
    """Twice the area of each triangle in the picture, (n,) [px²]; v points downwards, so negative if it looks here."""
    a, b, c = faces.T
    areas: Float64 = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a])
    return areas


def rasterise(
    points: Float32,
    faces: Int32,
    face_object: Int32,
    two_sided: NDArray[np.bool_],
    camera: Float32,
    shape: tuple[int, int],
) -> tuple[Float32, Int32, Float32]:
    """Return of each pixel: z-depth (h, w) [m], 0 where empty, face (h, w), -1 where empty, shares (h, w, 2).

    `points` are (n, 3) in the camera frame [m]; `camera` is (fx, fy, cx, cy); one-sided objects show their outside.
    """
    fx, fy, cx, cy = camera.astype(np.float64).tolist()
    u, v, nearness = project(points, (fx, fy, cx, cy))
    drawn = (points[:, 2] >= NEAR)[faces].all(axis=1)
    drawn &= two_sided[face_object] | (signed_areas(u, v, faces) < 0.0)
    nearest = np.zeros(shape)
    face_index = np.full(shape, -1, np.int32)
    shares = np.zeros((*shape, 2), np.float32)
    draw(u, v, nearness, faces, drawn, nearest, face_index, shares)
    depth = np.where(face_index >= 0, 1.0 / np.where(nearest > 0.0, nearest, 1.0), 0.0).astype(
        np.float32
    )
    return depth, face_index, shares


def shadow_map(points: Float32, faces: Int32, size: int, far: float) -> Float32:
    """Return an orthographic map (size, size) of the nearest depth towards the light, `far` where nothing is.

    `points` are (n, 3): columns 0 and 1 in map cells, column 2 the distance along the light [m].
    """
    u, v, distance = points.astype(np.float64).T.copy()
    nearest = np.full((size, size), -far)
    draw(u, v, -distance, faces, np.ones(len(faces), np.bool_), nearest)
    shadow: Float32 = (-nearest).astype(np.float32)
    return shadow


@kernel(nogil=True, fastmath=True)
def _lit(x: float, y: float, z: float, light: Float32, shadow: Float32, bias: float) -> float:
    """How much of the key light reaches a point: four neighbouring cells of the shadow map, averaged."""
    size = shadow.shape[0]
    u = light[0, 0] * x + light[0, 1] * y + light[0, 2] * z + light[0, 3]
    v = light[1, 0] * x + light[1, 1] * y + light[1, 2] * z + light[1, 3]
    d = light[2, 0] * x + light[2, 1] * y + light[2, 2] * z + light[2, 3] - bias
    iu = int(np.floor(u))
    iv = int(np.floor(v))
    if iu < 0 or iv < 0 or iu >= size - 1 or iv >= size - 1:
        return 1.0
    du = u - iu
    dv = v - iv
    s00 = 1.0 if shadow[iv, iu] > d else 0.0
    s01 = 1.0 if shadow[iv, iu + 1] > d else 0.0
    s10 = 1.0 if shadow[iv + 1, iu] > d else 0.0
    s11 = 1.0 if shadow[iv + 1, iu + 1] > d else 0.0
    return float((s00 * (1.0 - du) + s01 * du) * (1.0 - dv) + (s10 * (1.0 - du) + s11 * du) * dv)


class Surfaces(NamedTuple):
    """Appearance of the faces: values per vertex, faces, and values per object."""

    normals: Float32  # of vertices, in the camera frame
    albedo: Float32  # linear RGB of vertices
    grain: Float32  # coordinates of vertices in the noise
    openness: Float32  # ambient light that reaches a vertex, 0 to 1
    faces: Int32
    face_object: Int32
    material: Float32  # of objects: specular strength, shininess, contrast of the grain


class Visible(NamedTuple):
    """The result of `rasterise`, and its camera."""

    camera: Float32
    depth: Float32
    face_index: Int32
    weights: Float32


class TablePlane(NamedTuple):
    """The plane below the objects."""

    plane: Float32  # normal and offset in the camera frame; offset 0: no table
    axes: Float32  # (2, 4) of the texture
    look: Float32  # scale of the texture [texels/m], specular strength, shininess, radius of the table
    spheres: Float32  # (k, 4) that darken it
    texture: Float32


class Lighting(NamedTuple):
    """Light in the camera frame; the first light casts the shadow."""

    lights: Float32  # (l, 6): direction to the light, and colour
    up: Float32
    ambient: Float32
    light_map: Float32  # (3, 4)
    shadow: Float32
    shadow_strength: float


@kernel(nogil=True, fastmath=True)
def shade(
    surfaces: Surfaces,
    visible: Visible,
    table: TablePlane,
    lighting: Lighting,
    noise: Float32,
    picture: Float32,
    owner: Int32,
) -> None:
    """Colour every pixel that a face or the table covers; other pixels keep their value in `picture`.

    `owner` (h, w) becomes the object's index, -1 where none.
    """
    normals, albedo, grain, openness, faces, face_object, material = surfaces
    camera, depth, face_index, weights = visible
    plane, plane_axes, plane_look, spheres, texture = table
    lights, up, ambient, light_map, shadow, shadow_strength = lighting
    height, width = depth.shape
    fx = camera[0]
    fy = camera[1]
    cx = camera[2]
    cy = camera[3]
    texture_h = texture.shape[0]
    texture_w = texture.shape[1]
    noise_mask = noise.shape[0] - 1
    for v in range(height):
        for u in range(width):
            rx = (u - cx) / fx
            ry = (v - cy) / fy
            face = face_index[v, u]
            owner[v, u] = -1
            z = depth[v, u]
            along = plane[0] * rx + plane[1] * ry + plane[2]
            on_plane = False
            if plane[3] != 0.0 and along != 0.0:
                zp = plane[3] / along
                if zp > NEAR and (face < 0 or zp < z):
                    z = zp
                    on_plane = True
            if face < 0 and not on_plane:
                continue
            x = rx * z
            y = ry * z
            if on_plane:
                s = plane_axes[0, 0] * x + plane_axes[0, 1] * y + plane_axes[0, 2] * z
                t = plane_axes[1, 0] * x + plane_axes[1, 1] * y + plane_axes[1, 2] * z
                s0 = s - plane_axes[0, 3]
                t0 = t - plane_axes[1, 3]
                if s0 * s0 + t0 * t0 > plane_look[3] * plane_look[3]:
                    if face < 0:
                        continue
                    on_plane = False
                    z = depth[v, u]
                    x = rx * z
                    y = ry * z
            if on_plane:
                nx = plane[0]
                ny = plane[1]
                nz = plane[2]
                if along > 0.0:
                    nx = -nx
                    ny = -ny
                    nz = -nz
                ti = int(np.floor(t * plane_look[0])) % texture_h
                si = int(np.floor(s * plane_look[0])) % texture_w
                cr = texture[ti, si, 0]
                cg = texture[ti, si, 1]
                cb = texture[ti, si, 2]
                specular = plane_look[1]
                shininess = plane_look[2]
                openness_here = 1.0
                for k in range(spheres.shape[0]):
                    dx = spheres[k, 0] - x
                    dy = spheres[k, 1] - y
                    dz = spheres[k, 2] - z
                    d2 = dx * dx + dy * dy + dz * dz
                    r2 = spheres[k, 3] * spheres[k, 3]
                    if d2 < 9.0 * r2:
                        cosine = (dx * nx + dy * ny + dz * nz) / np.sqrt(d2)
                        if cosine > 0.0:
                            openness_here *= 1.0 - min(0.85, cosine * r2 / d2)
                object_id = -1
            else:
                a = faces[face, 0]
                b = faces[face, 1]
                c = faces[face, 2]
                wa = weights[v, u, 0]
                wb = weights[v, u, 1]
                wc = 1.0 - wa - wb
                object_id = face_object[face]
                owner[v, u] = object_id
                nx = wa * normals[a, 0] + wb * normals[b, 0] + wc * normals[c, 0]
                ny = wa * normals[a, 1] + wb * normals[b, 1] + wc * normals[c, 1]
                nz = wa * normals[a, 2] + wb * normals[b, 2] + wc * normals[c, 2]
                length = 1.0 / (np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-9)
                nx = nx * length
                ny = ny * length
                nz = nz * length
                if nx * rx + ny * ry + nz > 0.15:
                    nx = -nx
                    ny = -ny
                    nz = -nz
                cr = wa * albedo[a, 0] + wb * albedo[b, 0] + wc * albedo[c, 0]
                cg = wa * albedo[a, 1] + wb * albedo[b, 1] + wc * albedo[c, 1]
                cb = wa * albedo[a, 2] + wb * albedo[b, 2] + wc * albedo[c, 2]
                openness_here = wa * openness[a] + wb * openness[b] + wc * openness[c]
                contrast = material[object_id, 2]
                if contrast > 0.0:
                    gx = wa * grain[a, 0] + wb * grain[b, 0] + wc * grain[c, 0]
                    gy = wa * grain[a, 1] + wb * grain[b, 1] + wc * grain[c, 1]
                    gz = wa * grain[a, 2] + wb * grain[b, 2] + wc * grain[c, 2]
                    ix = int(np.floor(gx))
                    iy = int(np.floor(gy))
                    iz = int(np.floor(gz))
                    spot = (
                        noise[ix & noise_mask, iy & noise_mask]
                        * noise[iy & noise_mask, iz & noise_mask]
                    )
                    factor = 1.0 + contrast * spot
                    cr = cr * factor
                    cg = cg * factor
                    cb = cb * factor
                specular = material[object_id, 0]
                shininess = material[object_id, 1]
            sky = 0.5 + 0.5 * (nx * up[0] + ny * up[1] + nz * up[2])
            open_sky = openness_here * (0.35 + 0.65 * sky)
            lr = ambient[0] * open_sky
            lg = ambient[1] * open_sky
            lb = ambient[2] * open_sky
            hr = 0.0
            hg = 0.0
            hb = 0.0
            view = 1.0 / np.sqrt(rx * rx + ry * ry + 1.0)
            for k in range(lights.shape[0]):
                lx = lights[k, 0]
                ly = lights[k, 1]
                lz = lights[k, 2]
                cosine = nx * lx + ny * ly + nz * lz
                if cosine <= 0.0:
                    continue
                reach = 1.0
                if k == 0 and shadow_strength > 0.0:
                    reach = 1.0 - shadow_strength * (1.0 - _lit(x, y, z, light_map, shadow, 0.004))
                reach *= 0.5 + 0.5 * openness_here
                lr += reach * cosine * lights[k, 3]
                lg += reach * cosine * lights[k, 4]
                lb += reach * cosine * lights[k, 5]
                if specular > 0.0:
                    hx = lx - rx * view
                    hy = ly - ry * view
                    hz = lz - view
                    half = (nx * hx + ny * hy + nz * hz) / (
                        np.sqrt(hx * hx + hy * hy + hz * hz) + 1e-9
                    )
                    if half > 0.0:
                        gloss = specular * reach * half**shininess
                        hr += gloss * lights[k, 3]
                        hg += gloss * lights[k, 4]
                        hb += gloss * lights[k, 5]
            picture[v, u, 0] = cr * lr + hr
            picture[v, u, 1] = cg * lg + hg
            picture[v, u, 2] = cb * lb + hb
