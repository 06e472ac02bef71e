"""Floor 1: the joint model of the paper in NumPy: PD with motor strength, friction laws, dead band, ratio."""
