"""Into a framework of one's own: a policy as a Python function, and the range of friction to train with."""

import numpy as np

import stiction
from stiction.identification.example import example_log

robot = stiction.load_robot("saturn_lite")
STANDING = robot.joint_values("default_position")


def stand(sensors, command, fresh):
    """Return joint targets [rad], shape (N, J); what your framework's policy computes goes here."""
    return np.tile(STANDING, (len(command), 1))


result = stiction.evaluate(
    stand, robot="saturn_lite", friction_levels=[0.1], commands=["stand"], episodes=2, seconds=4.0
)
print(f"standing, falls: {result.rows[0].fall_rate:.0%}")

# The level of friction to cover, from a log; each robot draws its own, once an episode, from none up to it.
identified = stiction.identify(example_log(seed=2), test_condition="loaded")
level = identified.training["joints"]["shank"]["friction_level"]
share = np.random.default_rng(0).uniform(0.0, level, size=(4096, 1))
friction = share * robot.joint_values("torque_limit")
print(f"level {level:g}; Coulomb friction of {friction.shape} joints: {friction.min():.3f} to {friction.max():.3f} N m")
