"""Into a framework of one's own: a policy as a Python function, and the range of friction to train with."""

import numpy as np

import stiction
from stiction.identify.example import example_log

robot = stiction.load_robot("saturn_lite")
STANDING = robot.joint_values("default_position")


def stand(sensors, command, fresh):
    """Return joint targets [rad], shape (N, J); what your framework's policy computes goes here."""
    return np.tile(STANDING, (len(command), 1))


result = stiction.evaluate(
    stand, robot="saturn_lite", friction_levels=[0.1], commands=["stand"], episodes=2, seconds=4.0
)
print(f"standing, falls: {result.rows[0].fall_rate:.0%}")

# What identification proposes to train with; multiply each joint's torque limit with a draw from it, once an episode.
proposed = stiction.identify(example_log(seed=2), test_condition="loaded", torque_limit=5.0).training
low, high = proposed["range"]
print(proposed["text"])
draws = np.random.default_rng(0).uniform(low, high, size=(4096, 1)) * robot.joint_values("torque_limit")
print(f"Coulomb friction of 4096 robots: {draws.min():.3g} to {draws.max():.3g} N m")
