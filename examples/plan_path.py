"""A collision-free, timed path of an arm. Run: python examples/plan_path.py

The first run compiles the collision kernels, which takes half a minute.
Needs the distribution pomona.
"""

import numpy as np

from pomona.drivers import ArmLimits, Box, Workspace
from pomona.executive.values.installation import installed_trees
from pomona.skills.geometry import transform
from pomona.skills.motion.collision import CollisionWorld
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.plan import PlanRequest, plan
from pomona.skills.motion.robot import RobotModel

robot = RobotModel.load(
    installed_trees() / "robots" / "sia5f_wsg32.xml"
)  # MJCF, or a URDF of any serial arm
post = Box(
    "post", transform(np.eye(3), [-0.2, -0.34, 0.2]), (0.02, 0.02, 0.3)
)  # in the base frame, half sizes [m]
workspace = Workspace(
    table_z=-0.12,
    lower=np.array([-0.6, -0.8, -0.14]),
    upper=np.array([0.6, 0.2, 0.7]),
    obstacles=(post,),
)
space = ArmSpace(CollisionWorld.build(robot, workspace, None), width=robot.width_max)

q_start = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])  # joints [rad]
q_goal = q_start + np.array([-0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
limits = ArmLimits(
    robot.lower,
    robot.upper,
    velocity=np.full(7, 2.0),
    acceleration=np.full(7, 8.0),
    jerk=np.full(7, 80.0),
)
space.connect(
    q_start, q_goal[None], iterations=1, seed=0
)  # compiles the planner, outside its budget of time
planned = plan(PlanRequest(space, q_start, q_goal[None], limits, seed=1))
print(
    f"{planned.found_by}: {planned.path.duration:.2f} s, first path after {1e3 * planned.first_path_s:.0f} ms"
)
for share in (0.0, 0.5, 1.0):
    q = planned.path.q[round(share * (len(planned.path.q) - 1))]
    print(f"  {share:.0%}: gripper at {np.round(robot.tcp(q)[:3, 3], 3)} m")
