"""Runs in the formats of other tools: bags, datasets, live viewers, ROS 2. Imported only on request."""
