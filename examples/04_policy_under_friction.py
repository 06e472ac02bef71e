"""A policy as ONNX in a bundle: check it as a robot's computer would, then let it walk with friction in its joints."""

import stiction

print("shipped:", *stiction.list_policies())

# Your own: the directory of its bundle. Whatever is wrong with it raises a StictionError, in one line.
policy = stiction.load_policy("saturn_lite-flat-none-0.2")
print(policy)

# Few and short episodes, so that this ends soon; for a result leave both out.
result = stiction.evaluate(
    policy,
    friction_levels=(0.0, 0.2),  # dry friction as a fraction of each joint's torque limit
    commands=("vx=0.5",),
    episodes=2,
    seconds=4.0,
    jobs=1,
)
for row in result:
    print(f"friction {row.friction_level:g}: {row.speed_ratio:.0%} of the commanded speed, falls {row.fall_rate:.0%}")

print("written:", result.save("evaluation") / "report.html")
