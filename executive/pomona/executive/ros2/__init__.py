"""ROS 2 without ROS: its message types and their bytes. Knows nothing of runs, robots or devices."""
