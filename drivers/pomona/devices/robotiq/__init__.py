"""Robotiq's adaptive grippers: Hand-E, 2F-85 and 2F-140, over Modbus RTU or a UR's URCap."""
