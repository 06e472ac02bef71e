"""What runs on the robot's computer: a supervisor that alone can move the robot, a policy beside it, and a logger."""
