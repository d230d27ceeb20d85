"""Yaskawa arms with a MotoROS controller, over ROS-Industrial's simple message protocol."""
