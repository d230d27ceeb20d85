"""Yaskawa arms whose controller runs MotoROS, over ROS-Industrial's simple message."""
