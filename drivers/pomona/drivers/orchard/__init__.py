"""A simulated fruit wall: apples on stems that break by a law, wood that bends, leaves that hide."""
