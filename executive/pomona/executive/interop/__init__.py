"""Runs in other people's words: bags, datasets, live viewers, ROS 2. No run imports it unasked."""
