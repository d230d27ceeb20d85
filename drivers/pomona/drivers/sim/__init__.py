"""A simulated picking cell: MuJoCo's physics behind the interfaces of real devices.

The names below are public, and loaded on first use: a world of one's own is built of them.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.drivers.sim.camera import SimCamera as SimCamera
    from pomona.drivers.sim.fruit_model import (
        UnusableModel as UnusableModel,
        read_model as read_model,
    )
    from pomona.drivers.sim.fruit_shape import (
        SKINS as SKINS,
        FruitShape as FruitShape,
        make_fruit as make_fruit,
    )
    from pomona.drivers.sim.gl import load_mujoco as load_mujoco
    from pomona.drivers.sim.layout import FRICTION as FRICTION
    from pomona.drivers.sim.robot import (
        FINGERS as FINGERS,
        PADS as PADS,
        read_robot as read_robot,
    )
    from pomona.drivers.sim.scene import (
        TIMESTEP as TIMESTEP,
        add_fixed as add_fixed,
        add_lights as add_lights,
        add_material as add_material,
        container_of as container_of,
        quaternion as quaternion,
        set_physics as set_physics,
    )
    from pomona.drivers.sim.world import (
        PhysicsWorld as PhysicsWorld,
        SimWorld as SimWorld,
    )

PUBLIC = {
    "camera": "SimCamera",
    "fruit_model": "UnusableModel read_model",
    "fruit_shape": "FruitShape SKINS make_fruit",
    "gl": "load_mujoco",
    "layout": "FRICTION",
    "robot": "FINGERS PADS read_robot",
    "scene": "TIMESTEP add_fixed add_lights add_material container_of quaternion set_physics",
    "world": "PhysicsWorld SimWorld",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
