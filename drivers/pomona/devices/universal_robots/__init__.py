"""Universal Robots arms (CB3, e-series, UR20 and UR30), over RTDE and a resident script."""
