"""Code that runs on the robot: bundle checks, observation builder, policy. No torch, no simulator."""
