"""The occupancy map as skills that move may use it: not when it is empty or too old."""

from __future__ import annotations

from pomona.executive.skill import Skill
from pomona.skills.motion.collision.distance_field import DistanceField
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.occupancy.occupancy_map import OccupancyError

MAP_AGE = 120.0  # an occupancy map whose newest look is older than this is stale [s]


def usable_field(skill: Skill, map: OccupancyMap | None, max_age: float = MAP_AGE) -> DistanceField | None:
    """Return the distance field of a map that may be relied on; None where no map is wired.

    `skill` must declare MAP_STALE: it fails with it when the map is empty or too old.
    """
    if map is None:
        return None
    try:
        return map.usable_field(skill.clock.now(), max_age)
    except OccupancyError as unusable:
        stamp = map.stamp
        age = None if stamp is None else round(skill.clock.now() - stamp, 3)
        raise skill.failure("MAP_STALE", f"{unusable}: look again", age_s=age, allowed_s=max_age) from unusable
