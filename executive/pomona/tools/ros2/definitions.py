"""Definitions of the messages that no distribution of ROS 2 contains, in ROS 2's own language.

`pomona_msgs` belongs to Pomona: interop.md has every field with its unit. `py_trees_ros_interfaces` is
copied as published, without the comments.
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
uint32 pause
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

SERVICES: Mapping[str, tuple[str, str]] = {
    "pomona_msgs/srv/Act": (
        "string token\nstring who\nstring detail\n",
        "bool success\nstring message\n",
    ),
    "pomona_msgs/action/RunTree_SendGoal": (
        "unique_identifier_msgs/UUID goal_id\npomona_msgs/action/RunTree_Goal goal\n",
        "bool accepted\nbuiltin_interfaces/Time stamp\n",
    ),
    "pomona_msgs/action/RunTree_GetResult": (
        "unique_identifier_msgs/UUID goal_id\n",
        "int8 status\npomona_msgs/action/RunTree_Result result\n",
    ),
    "action_msgs/srv/CancelGoal": (
        "action_msgs/GoalInfo goal_info\n",
        """\
int8 ERROR_NONE=0
int8 ERROR_REJECTED=1
int8 ERROR_UNKNOWN_GOAL_ID=2
int8 ERROR_GOAL_TERMINATED=3
int8 return_code
action_msgs/GoalInfo[] goals_canceling
""",
    ),
}
"""Request and response of services: ours, and those of which an action is made."""

ACTIONS: Mapping[str, str] = {
    "pomona_msgs/action/RunTree_Goal": """\
string token
string who
string tree
string cell
uint32 seed
string[] names
string[] values
""",
    "pomona_msgs/action/RunTree_Result": "string outcome\nstring code\nstring reason\nfloat64 time\n",
    "pomona_msgs/action/RunTree_Feedback": "string node\nstring status\nstring feedback\nfloat64 t\nuint32 tick\n",
    "pomona_msgs/action/RunTree_FeedbackMessage": """\
unique_identifier_msgs/UUID goal_id
pomona_msgs/action/RunTree_Feedback feedback
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
}
