"""Force/torque sensors between flange and hand: Robotiq FT 300, and that of a Universal Robots e-series."""
