"""Fruit over many frames: sightings of the same fruit, and its size from all of them.

sighting      one fruit in one frame, as numbers association   which sightings of a frame show fruit that is known
fusion        one size from several looks, and whether they agree camera_motion motion of the camera between two frames
without poses book          all fruit so far
"""
