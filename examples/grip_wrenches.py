"""Grip control on a stream of wrenches: bias, closing, holding a load. Run: python examples/grip_wrenches.py

The fruit is a spring between the pads. At 1.5 s it is lifted: its weight loads the pads. With a recording of your own,
replace `wrenches` by its samples and ignore the commanded speed.
Needs the distribution pomona.
"""

import numpy as np

from pomona.skills.grip.controller import GripController
from pomona.skills.grip.limit_surface import SoftContact, least_force
from pomona.skills.grip.settings import GripSettings

# [N/m], [m], [N], [s]
STIFFNESS = 1500.0
FRUIT = 0.08
WEIGHT = 1.5
PERIOD = 0.002
contact = SoftContact(mu=0.7, delta=0.003, gamma=0.33)
controller = GripController(GripSettings(contact=contact))
rng = np.random.default_rng(3)
# [m], [m/s]; negative closes
width = 0.09
speed = 0.0

for n in range(1500):
    width += speed * PERIOD
    normal = max(0.0, STIFFNESS * (FRUIT - width))
    load = WEIGHT / 2 * np.clip((n * PERIOD - 1.5) / 0.2, 0.0, 1.0)
    wrenches = rng.normal(0.0, 0.02, (2, 6)) * [1, 1, 1, 0.01, 0.01, 0.01]
    wrenches[:, 0] -= load
    wrenches[:, 2] -= normal
    if controller.wants_width:
        controller.width = width
    commanded = controller.step(stamp=n * PERIOD, sequence=n, wrenches=wrenches)
    speed = speed if commanded is None else commanded
    if n % 250 == 249:
        print(
            f"{(n + 1) * PERIOD:.1f} s  {controller.phase.name:<8} grip {2 * normal:5.2f} N  load {2 * load:4.2f} N"
        )

needed = least_force([WEIGHT / 2, WEIGHT / 2], [0.0, 0.0], contact).sum()
print(f"minimum grip force of this load, without a margin: {needed:.2f} N")
