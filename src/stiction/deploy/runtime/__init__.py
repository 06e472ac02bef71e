"""Runtime on the robot's computer: a supervisor that alone can move the robot, a policy and a logger."""
