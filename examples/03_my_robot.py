"""My own robot from a MuJoCo file: read it, see what is known of it, and what to mend before it is trained."""

from pathlib import Path

import stiction

# A file to try this with: Unitree's Go1 as MuJoCo has it. Yours is an MJCF or URDF with a few lines of robot.yaml.
stiction.check_robot("go1").save("go1")
print(*sorted(path.name for path in Path("go1").iterdir()))

check = stiction.check_robot("go1/robot.yaml")
print(check)
for finding in check:
    if finding.state != "good":
        print(f"{finding.check}: {finding.text}; {finding.mend}")

robot = check.robot
for joint in robot.joints[:3]:
    print(f"{joint.name}: {joint.torque_limit:g} N m, kp {joint.kp:g} N m/rad, armature {joint.armature:g} kg m²")

# An hour later: stiction.train("runs/mine", robot="go1/robot.yaml", method="deception", friction_level=0.2)
