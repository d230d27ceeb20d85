"""Training of detectors: rendered and photographed pictures, networks, evaluation, published figures."""
