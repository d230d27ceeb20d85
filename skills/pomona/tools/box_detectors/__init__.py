"""Detectors of boxes that anyone trained, as ONNX files, posed by the close look or by depth."""
