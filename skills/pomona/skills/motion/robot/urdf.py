"""URDF as other tools write it, prepared for MuJoCo: files of meshes found, and nothing in it that is only drawn.

Names of mesh files are found as ROS finds them: `package://NAME/…` above the file and in the environment's paths,
`file://…`, or relative to the file.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

from pomona.skills.motion.robot.errors import BadRobotFile

SOFT = "safety_controller"  # narrows the range of its joint
NUMBERED = (
    "origin",
    "axis",
    "mass",
    "inertia",
    "box",
    "cylinder",
    "sphere",
    "dynamics",
    SOFT,
)  # with numbers alone
ONLY_SEEN = "only_seen"  # mark of a link of which only drawn geometry is known
READ = (".stl", ".obj", ".msh")  # endings of mesh files that MuJoCo reads
SMALLEST = {"boundmass": "1e-6", "boundinertia": "1e-9", "balanceinertia": "true"}
"""For links without inertia [kg, kg m²], since only geometry is used; vendors round theirs: an xArm 6 has A + B < C."""


def read_urdf(path: Path) -> ElementTree.Element | None:
    """Return the root of a URDF with absolute paths of its collision meshes; None for a file that is none.

    Raises BadRobotFile: it is broken, two joints have one name, or a mesh is not found or in no format that is read.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError, ValueError) as error:
        # MuJoCo may read it, and nothing here would be judged
        if path.is_file() and b"<robot" in path.read_bytes():
            raise BadRobotFile(path, f"cannot be read as XML: {error}") from error
        return None  # MuJoCo gives the reason
    space = root.tag.removesuffix("robot")  # MuJoCo reads no namespaces
    if root.tag != f"{space}robot":
        return None
    for part in root.iter():
        part.tag = part.tag.removeprefix(space)
    names = [joint.get("name", "") for joint in root.findall("joint")]
    if twice := [name for name in names if names.count(name) > 1]:
        raise BadRobotFile(path, f"has two joints with the name '{twice[0]}'")
    held = {child.get("link") for child in root.findall("joint/child")}
    if (
        len(
            roots := [
                link.get("name", "")
                for link in root.findall("link")
                if link.get("name") not in held
            ]
        )
        > 1
    ):
        raise BadRobotFile(
            path,
            f"has several roots: {', '.join(roots)}; every link but one is the child of a joint",
        )
    for part in root.iter():
        if "/xacro}" in part.tag or any(
            re.search(r"\$[{(]", text) for text in part.attrib.values()
        ):
            raise BadRobotFile(
                path,
                f"<{part.tag.split('}')[-1]}> has words of xacro: first `xacro FILE > arm.urdf`",
            )
        for key, text in part.attrib.items() if part.tag in NUMBERED else ():
            if {"nan", "inf"} & set(re.findall("[a-z]+", text.lower().replace("infinity", "inf"))):
                raise BadRobotFile(
                    path, f'<{part.tag} {key}="{text}"> is not finite: correct or remove it'
                )
            if "," in text:
                raise BadRobotFile(
                    path, f'<{part.tag} {key}="{text}"> has a comma: use 0.5 and spaces in between'
                )
            if part.tag == "axis" and not re.search("[1-9]", text):
                raise BadRobotFile(
                    path, f'<axis {key}="{text}"> has no direction: write 0 0 1 for z'
                )
            if part.tag == "origin" and re.search(r"(?:^|\s)[+-]?\d\d[\d.]*(?:\s|$)", text):
                unit = (
                    "m off or more: is it in millimetres"
                    if key == "xyz"
                    else "rad or more: is it in degrees"
                )
                raise BadRobotFile(path, f'<origin {key}="{text}"> is 10 {unit}?')
    for joint in root.findall("joint[limit][safety_controller]"):
        limit, soft = (part.attrib for name in ("limit", SOFT) for part in joint.findall(name)[:1])
        for key, narrower in (("lower", max), ("upper", min)):
            if {key, f"soft_{key}_limit"} <= limit.keys() | soft.keys():
                try:
                    limit[key] = narrower(limit[key], soft[f"soft_{key}_limit"], key=float)
                except ValueError as error:
                    raise BadRobotFile(
                        path, f"the joint '{joint.get('name')}': limit '{key}': {error}"
                    ) from error
    compiler = root.find("mujoco/compiler")
    own_folder = compiler is not None and "meshdir" in compiler.attrib
    for mesh in (
        []
        if own_folder
        else [mesh for part in root.iter("collision") for mesh in part.iter("mesh")]
    ):
        mesh.set("filename", str(_found(path, mesh.get("filename", ""))))
    if compiler is None:
        extensions = root.findall("mujoco") or [ElementTree.SubElement(root, "mujoco")]
        compiler = ElementTree.SubElement(extensions[0], "compiler")
    for key, text in () if own_folder else {"strippath": "false", **SMALLEST}.items():
        compiler.set(key, text)
    for link in root.iter("link"):
        shown = link.findall("visual")
        for visual in shown:
            link.remove(visual)
        if shown and link.find("collision") is None:
            link.set(ONLY_SEEN, "true")
    return root


def seen_only(root: ElementTree.Element | None) -> list[str]:
    """Return the links that have drawn geometry and none for collisions."""
    return (
        []
        if root is None
        else [link.get("name", "") for link in root.iter("link") if link.get(ONLY_SEEN)]
    )


def leaders(root: ElementTree.Element | None) -> dict[str, str]:
    """Return by the name of each joint that follows another one (`mimic`) the name of that one."""
    joints = [] if root is None else root.findall("joint")
    mimics = {joint.get("name", ""): joint.find("mimic") for joint in joints}
    return {
        name: mimic.get("joint", "") or "another joint"
        for name, mimic in mimics.items()
        if mimic is not None
    }


def _found(urdf: Path, name: str) -> Path:
    places = list(dict.fromkeys(_places(urdf.resolve(), name)))
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        looked = ", ".join(str(place.parent) for place in places[:4]) + (
            ", …" if len(places) > 4 else ""
        )
        remedy = "put its package beside the file or into ROS_PACKAGE_PATH, or write a path relative to the file"
        raise BadRobotFile(
            urdf, f"the mesh '{name}' is not found (looked in {looked or 'no folder'}): {remedy}"
        )
    # Kinova's package has the same shape beside it, in a format that is read
    if found.suffix.lower() not in READ:
        beside = [path for path in sorted(found.parent.glob("*")) if path.suffix.lower() in READ]
        found = next((path for path in beside if path.stem == found.stem), found)
    if found.suffix.lower() not in READ:
        words = f"the mesh '{name}' is a {found.suffix} file, and {', '.join(READ)} are read"
        raise BadRobotFile(
            urdf, f"{words}: convert it, with Blender or MeshLab, and name that file in <collision>"
        )
    return found


def _places(urdf: Path, name: str) -> Iterator[Path]:
    scheme, _, rest = name.partition("://")
    if not rest:
        yield urdf.parent / name
        yield urdf.parent / Path(name).name
    elif scheme == "file":
        yield Path(unquote(urlsplit(name).path))
    elif scheme in ("package", "model"):
        package, _, inside = rest.partition("/")
        above = list(urdf.parents)
        yield from (folder / inside for folder in above if folder.name == package)
        yield from (folder / package / inside for folder in above)
        for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
            roots = [
                Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry
            ]
            yield from (root / below / package / inside for root in roots)
            yield from (root / inside for root in roots if root.name == package)
        yield from (folder / inside for folder in above[:4])
