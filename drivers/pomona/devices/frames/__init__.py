"""A folder of recorded colour and depth images as a camera."""
