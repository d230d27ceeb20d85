"""The executive runs task trees. It knows no fruit, no robot and no device."""
