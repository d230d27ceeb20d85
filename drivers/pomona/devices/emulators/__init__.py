"""Emulators of the real devices, byte for byte, on TCP ports, pseudo terminals and CAN buses, alone or on a world."""
