"""Joint model of the paper in NumPy: PD with motor strength, friction laws, simulation, Actuator Net."""
