"""The harvest: a simulated fruit wall, hanging fruit that is gripped and detached."""
