"""UFACTORY arms (xArm 5, 6, 7, Lite 6, 850) in servo mode, over the controller's own protocol."""
