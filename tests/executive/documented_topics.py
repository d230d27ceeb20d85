"""The table of topics and the definitions of messages that interop.md has."""

from __future__ import annotations

import re
from pathlib import Path

TEXT = (
    Path(__file__).parents[2] / "executive" / "pomona" / "tools" / "ros2" / "interop.md"
).read_text()
MESSAGE = re.compile(r"\w+/(?:msg|srv|action)/\w+")


def rows() -> dict[str, set[str]]:
    """Types of each topic; NAME and DEVICE stand for anything, finger_1 for any finger."""
    found: dict[str, set[str]] = {}
    for line in TEXT.splitlines():
        if line.startswith("| `/"):
            topic, kinds, meaning = (cell.strip() for cell in line.strip("|").split("|"))
            assert meaning, line
            package, *others = re.findall(r"`([\w/]+)`", kinds)
            group = package.rpartition("/")[0]
            found[topic.strip("`")] = {package, *(f"{group}/{name}" for name in others)}
    return found


def row_of(topic: str) -> str:
    """The row that speaks of a topic."""
    fitting = [
        row
        for row in rows()
        if re.fullmatch(
            row.replace("NAME", r"[\w/]+")
            .replace("DEVICE", r"\w+")
            .replace("finger_1", r"finger_\d+"),
            topic,
        )
    ]
    assert len(fitting) == 1, (topic, fitting)
    return fitting[0]


def definitions() -> dict[str, str]:
    """Return definitions of Pomona's own types from their files, without comments: `pomona_msgs/msg/Sample`."""
    found: dict[str, list[str]] = {}
    name = ""
    for line in TEXT.splitlines():
        begin = re.fullmatch(r"    # (msg|srv|action)/(\w+)\.\1", line)
        if begin:
            name = f"pomona_msgs/{begin[1]}/{begin[2]}"
            found[name] = []
        elif name and line.startswith("    "):
            found[name].append(line.partition("#")[0].strip())
        elif line:
            name = ""
    return {name: "".join(f"{line}\n" for line in lines if line) for name, lines in found.items()}
