"""Definitions of the messages that no distribution of ROS 2 brings along, in ROS 2's own language.

`pomona_msgs` is ours: docs/interop.md has every field with its unit, and how to build the package.
`py_trees_ros_interfaces` and `octomap_msgs` are other people's, as they are published, without the
comments.
"""

from __future__ import annotations

from collections.abc import Mapping

POMONA: Mapping[str, str] = {
    "pomona_msgs/msg/NodeStatus": """\
string path
string parent
string name
string type
string status
string feedback
uint32 starts
string code
string reason
""",
    "pomona_msgs/msg/TreeStatus": """\
std_msgs/Header header
string run
string tree
string state
string because
uint32 tick
pomona_msgs/NodeStatus[] nodes
""",
    "pomona_msgs/msg/Sample": """\
std_msgs/Header header
float64 t
string[] names
float64[] values
""",
}

OTHERS: Mapping[str, str] = {
    "py_trees_ros_interfaces/msg/KeyValue": "string key\nstring value\n",
    "py_trees_ros_interfaces/msg/Behaviour": """\
uint8 INVALID = 1
uint8 RUNNING = 2
uint8 SUCCESS = 3
uint8 FAILURE = 4
uint8 UNKNOWN_TYPE = 0
uint8 BEHAVIOUR = 1
uint8 SEQUENCE = 2
uint8 SELECTOR = 3
uint8 PARALLEL = 4
uint8 CHOOSER = 5
uint8 DECORATOR = 6
uint8 COMPOSITE = 7
uint8 BLACKBOX_LEVEL_DETAIL = 1
uint8 BLACKBOX_LEVEL_COMPONENT = 2
uint8 BLACKBOX_LEVEL_BIG_PICTURE = 3
uint8 BLACKBOX_LEVEL_NOT_A_BLACKBOX = 4
string BLACKBOARD_ACCESS_READ = "r"
string BLACKBOARD_ACCESS_WRITE = "w"
string BLACKBOARD_ACCESS_EXCLUSIVE_WRITE = "x"
string name
string class_name
unique_identifier_msgs/UUID own_id
unique_identifier_msgs/UUID parent_id
unique_identifier_msgs/UUID tip_id
unique_identifier_msgs/UUID[] child_ids
unique_identifier_msgs/UUID current_child_id
uint8 type
string additional_detail
uint8 blackbox_level
uint8 status
string message
bool is_active
py_trees_ros_interfaces/KeyValue[] blackboard_access
""",
    "py_trees_ros_interfaces/msg/BehaviourTree": """\
int64 tick
builtin_interfaces/Time stamp
py_trees_ros_interfaces/Behaviour[] behaviours
""",
    "octomap_msgs/msg/Octomap": "std_msgs/Header header\nbool binary\nstring id\nfloat64 resolution\nint8[] data\n",
}
