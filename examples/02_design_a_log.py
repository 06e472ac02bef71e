"""Before the robot is touched: a motion whose log will show friction well, tried on a simulated joint."""

import stiction

design = stiction.excite(
    joint="knee",
    torque_limit=20.0,
    position_limits=(-0.5, 0.5),
    coulomb=0.2,  # a guess; the design holds for half and twice as much
    kp=4.0,
    kd=0.2,
    fixed_gains=True,  # without it lower gains are tried too, which takes longer
    duration=5.0,
    rate=200.0,
)
print(design)
print("written:", design.save("excite") / "trajectory.csv")

# Play it back on your robot. Until then: the joint as guessed, with the noise of small geared actuators.
log = design.simulate(seed=0)
result = stiction.identify(log, test_condition="bare_motor")
friction = result["knee"].coulomb_friction
print(f"Coulomb friction {friction.value:.3f} ± {friction.std:.3f} N m, and the truth is 0.2")
