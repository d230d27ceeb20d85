"""ROS 2 without ROS: message types, their bytes, a peer on the wire, bags and the bridge of a run."""
