"""Virtual robot: an engine with hidden joints, sensors, wear, and its test bench, in place of a real robot."""
