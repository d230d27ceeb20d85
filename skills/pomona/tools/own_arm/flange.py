"""Where the arm of a URDF ends: the link that the hand is bolted on."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from collections.abc import Iterator, Mapping

from pomona.executive.errors import UsageError

NAMES = ("tool0", "flange", "link_eef", "link8", "end_effector_link", "link_ee", "ee_link")
"""Names of a flange in the order of preference, as vendors write them after a prefix."""
MOVABLE = ("revolute", "continuous", "prismatic")

Children = Mapping[str, list[ElementTree.Element]]


def choose_flange(root: ElementTree.Element, said: str | None) -> str:
    """Return the link that the hand is bolted on: the one that is named, else the end of the only chain.

    The chain follows joints that move by themselves, up to where fingers part. Of the frames fixed on its last link the
    first of `NAMES` is taken, else the link itself.

    Raises UsageError: no such link, or nothing moves in one chain.
    """
    links = [link.get("name", "") for link in root.findall("link")]
    if said is not None:
        if said not in links:
            raise UsageError(f"--flange: the file has no link '{said}'; it has {', '.join(links)}")
        return said
    children: dict[str, list[ElementTree.Element]] = defaultdict(list)
    for joint in root.findall("joint"):
        children[_end(joint, "parent")].append(joint)
    ends = {_end(joint, "child") for joint in root.findall("joint")}
    last = _last_link(next((name for name in links if name not in ends), ""), children)
    if last is None:
        tips = _tips(links, children)
        raise UsageError(
            f"no single chain of joints leads from the base to a hand: --flange LINK names its end ({tips})"
        )
    fixed = list(_fixed_on(last, children))
    return next((name for end in NAMES for name in fixed if name.endswith(end)), last)


def _last_link(link: str, children: Children) -> str | None:
    last = None
    seen = {link}
    while True:
        onward = [joint for joint in children.get(link, ()) if _moves(joint, children, set(seen))]
        if len(onward) != 1 or onward[0].find("mimic") is not None:
            return last
        link = _end(onward[0], "child")
        if link in seen:
            return last
        seen.add(link)
        if onward[0].get("type") in MOVABLE:
            last = link


def _moves(joint: ElementTree.Element, children: Children, seen: set[str]) -> bool:
    """Return whether a joint, or one beyond it, can move."""
    link = _end(joint, "child")
    if joint.get("type") in MOVABLE or link in seen:
        return joint.get("type") in MOVABLE
    return any(_moves(beyond, children, seen | {link}) for beyond in children.get(link, ()))


def _fixed_on(link: str, children: Children) -> Iterator[str]:
    for joint in children.get(link, ()):
        if joint.get("type") == "fixed":
            yield _end(joint, "child")
            yield from _fixed_on(_end(joint, "child"), children)


def _tips(links: list[str], children: Children) -> str:
    tips = [name for name in links if not children.get(name)]
    return ", ".join(tips[:6]) + (", …" if len(tips) > 6 else "")


def _end(joint: ElementTree.Element, which: str) -> str:
    found = joint.find(which)
    return "" if found is None else found.get("link", "")
