"""Networks in PyTorch: their definitions, their weights, and DOPE's full network as a detector."""
