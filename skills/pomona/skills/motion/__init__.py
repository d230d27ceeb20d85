"""From a fruit to a path: robot, collision, map, planning, grasps. No py_trees, no devices."""
