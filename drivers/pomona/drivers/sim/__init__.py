"""A simulated picking cell: MuJoCo's physics behind the interfaces of real devices."""
