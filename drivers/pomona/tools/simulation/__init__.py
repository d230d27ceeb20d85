"""A simulated picking cell: MuJoCo's physics behind the interfaces of real devices.

The names below are public, and loaded on first use: a world of one's own is built of them.
"""

from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use

if TYPE_CHECKING:
    from pomona.tools.simulation.bruises import (
        Press as Press,
        Presses as Presses,
        press_figures as press_figures,
    )
    from pomona.tools.simulation.camera import SimCamera as SimCamera
    from pomona.tools.simulation.fruit_shape import (
        APPLES as APPLES,
        FruitShape as FruitShape,
    )
    from pomona.tools.simulation.gl import load_mujoco as load_mujoco
    from pomona.tools.simulation.intruder import (
        IntruderSection as IntruderSection,
        add_intruder as add_intruder,
    )
    from pomona.tools.simulation.layout import (
        PADS as PADS,
        CellFruitSection as CellFruitSection,
        DrawnOptions as DrawnOptions,
        FruitOnTable as FruitOnTable,
        read_robot as read_robot,
    )
    from pomona.tools.simulation.scene import (
        TABLE_FRICTION as TABLE_FRICTION,
        TIMESTEP as TIMESTEP,
        add_contact_sensors as add_contact_sensors,
        add_fixed as add_fixed,
        add_fruit as add_fruit,
        add_lights as add_lights,
        add_material as add_material,
        container_of as container_of,
        quaternion as quaternion,
        set_physics as set_physics,
        standing_pose as standing_pose,
    )
    from pomona.tools.simulation.world import (
        FaultyDevice as FaultyDevice,
        PhysicsWorld as PhysicsWorld,
        SimWorld as SimWorld,
    )

PUBLIC = {
    "bruises": "Press Presses press_figures",
    "camera": "SimCamera",
    "fruit_shape": "APPLES FruitShape",
    "gl": "load_mujoco",
    "intruder": "IntruderSection add_intruder",
    "layout": "CellFruitSection DrawnOptions FruitOnTable PADS read_robot",
    "scene": (
        "TABLE_FRICTION TIMESTEP add_contact_sensors add_fixed add_fruit add_lights add_material container_of "
        "quaternion set_physics standing_pose"
    ),
    "world": "FaultyDevice PhysicsWorld SimWorld",
}
"""Public names by the module that defines them."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
