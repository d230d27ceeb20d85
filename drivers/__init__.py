"""Devices behind Protocols: real, simulated, emulated and mock, told apart by a cell file."""
