"""FeelFriction: how slippery this fruit is, from sliding the pads over it by a millimetre before it is lifted."""
