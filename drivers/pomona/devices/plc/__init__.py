"""Signals of a PLC: the device `Signals`, over Modbus TCP, simulated, and a mock; the Modbus client is public."""
