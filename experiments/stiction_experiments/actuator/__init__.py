"""The loop of an Actuator Net: f0, log, f_motor, f1."""
