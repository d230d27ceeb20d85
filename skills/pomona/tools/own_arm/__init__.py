"""A simulated cell around another arm, from its URDF: `pomona new arm FILE.urdf`."""
