"""Fingertips without shear: Robotiq TSF-85, which measure contact and pressing force."""
