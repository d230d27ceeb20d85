"""Weiss Robotics WSG grippers: binary command set over CAN or TCP."""
