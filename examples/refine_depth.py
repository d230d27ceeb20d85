"""True size and position of a fruit from a depth image. Run: python examples/refine_depth.py

A fruit that is smaller than its CAD model and nearer to the camera has the same keypoints. Depth tells both apart.
Needs the distribution pomona.
"""

import numpy as np

from pomona.drivers import Intrinsics
from pomona.skills.geometry import rot_x, rot_y, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement import DepthLook, refine, render_depth

apple = load_fruit("apple")
camera = Intrinsics(fx=615.0, fy=615.0, cx=319.5, cy=239.5, width=640, height=480)
T_camera_detected = transform(
    rot_x(0.8) @ rot_y(0.3), [0.03, 0.01, 0.45]
)  # pose by keypoints and the CAD size

# A depth image [m] of an apple of 0.9 times the CAD size before a wall, with 1 mm of noise.
scale = 0.9
T_camera_true = transform(scale * T_camera_detected[:3, :3], scale * T_camera_detected[:3, 3])
fruit, box = render_depth(apple, T_camera_true, camera, using="zbuffer")
depth = np.full((camera.height, camera.width), 0.6, np.float32)
depth[box.slices] = np.where(fruit > 0.0, fruit, depth[box.slices])
depth += np.random.default_rng(1).normal(0.0, 1e-3, depth.shape).astype(np.float32)

look = DepthLook(depth, camera, renderer="zbuffer")
found = refine(look, T_camera_detected, apple, method="uniform")
error = np.linalg.norm(found.T_camera_object[:3, 3] - scale * T_camera_detected[:3, 3])
print(
    f"scale {found.mu:.4f} (true {scale}), position error {1e3 * error:.2f} mm, inliers {found.inlier_ratio:.0%}"
)
print(f"dimensions {1e3 * found.dimensions} mm, CAD model {1e3 * apple.dimensions} mm")
