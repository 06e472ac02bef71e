"""The virtual robot that plays the real one: an engine with hidden joints, sensors, wear, and its test bench."""
