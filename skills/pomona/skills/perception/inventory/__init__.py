"""Fruit over many frames: which sightings show the same fruit, and how large it is by all of them.

sighting      one fruit in one frame, as numbers
association   which sightings of a frame show fruit that is known
fusion        one size from several looks, and whether they agree
camera_motion where the camera went between two frames of which nobody says it
book          all fruit so far
"""
