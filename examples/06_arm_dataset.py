"""A recording of an arm of hobby servos, as LeRobot keeps it: 30 Hz, degrees, no torque. Its dead bands are known.

Needs pyarrow, of the extra `logs`. Each servo pulls towards its target by kp and brakes by kd; gravity bends shoulder,
elbow and wrist; dry friction f stops every joint within f/kp of where it should be.
"""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
KP, KD = 8.0, 0.3  # [N m/rad], [N m s/rad]
INERTIA = np.array([0.03, 0.03, 0.015, 0.005, 0.003, 0.003])  # [kg m²]
GRAVITY = np.array([0.0, 0.8, 0.5, 0.1, 0.0, 0.0])  # [N m], times sin(angle)
FRICTION = np.array([0.30, 0.25, 0.25, 0.15, 0.12, 0.10])  # [N m]
RATE, SECONDS, SUBSTEPS = 30, 60, 100
ENCODER = 360 / 4096  # [deg]

draw = np.random.default_rng(0)
count, step = RATE * SECONDS, 1 / (RATE * SUBSTEPS)
goal, speed, hand = np.zeros(6), np.zeros(6), np.zeros(6)
angle, velocity = np.zeros(6), np.zeros(6)
target, measured = np.zeros((count, 6)), np.zeros((count, 6))

for frame in range(count):
    # Somebody moves the leader arm: smoothly, now and then to another pose.
    goal = np.where(draw.random(6) < 0.02, draw.uniform(-0.8, 0.8, 6), goal)
    speed += (4 * (goal - hand) - 4 * speed) / RATE
    hand = hand + speed / RATE
    target[frame], measured[frame] = hand, angle
    for _ in range(SUBSTEPS):
        free = velocity + step * (KP * (hand - angle) - KD * velocity - GRAVITY * np.sin(angle)) / INERTIA
        # Dry friction stops a joint, and never turns it round.
        velocity = np.sign(free) * np.maximum(np.abs(free) - step * FRICTION / INERTIA, 0)
        angle = angle + step * velocity

state, action = np.round(np.degrees(measured) / ENCODER) * ENCODER, np.degrees(target)
rows = pa.list_(pa.float32())
pq.write_table(
    pa.table(
        {
            "action": pa.array(action.tolist(), rows),
            "observation.state": pa.array(state.tolist(), rows),
            "timestamp": pa.array((np.arange(count) / RATE).astype(np.float32)),
        }
    ),
    "arm.parquet",
)
print("written: arm.parquet, dead bands", " ".join(f"{band:.2f}" for band in np.degrees(FRICTION / KP)), "deg")
