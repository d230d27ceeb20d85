"""Intel RealSense depth cameras; the library is imported only when such a camera is opened."""
