"""Devices that are topics of ROS 2."""
