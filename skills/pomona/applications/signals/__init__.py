"""Signals of a PLC in a tree: wait for one, set one, and a handshake of four edges."""
