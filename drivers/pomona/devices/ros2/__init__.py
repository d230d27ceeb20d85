"""ROS 2 topics and bags as devices."""
