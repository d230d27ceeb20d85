"""Signals of a PLC: the device `Signals`, over Modbus TCP or simulated, and skills on it; the Modbus client is public."""
