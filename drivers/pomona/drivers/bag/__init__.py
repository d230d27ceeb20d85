"""The images of a bag of ROS as a camera."""
