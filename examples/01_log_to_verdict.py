"""From the log of a joint to a verdict: how much dry friction it has, whether it matters, what to do."""

from pathlib import Path

import stiction
from stiction.files.log import write_log
from stiction.identification.example import LEG, example_log

# A log to try this with: a leg that hangs in the air, its true dry friction 0.442 N m. Yours is a file too, and stays.
if not Path("swing.csv").exists():
    write_log(Path("swing.csv"), example_log(LEG, seed=1))

log = stiction.load_log("swing.csv")  # gains and torque limit are in swing.json beside it
result = stiction.identify(log)
print(result)

for name, joint in result.joints.items():
    friction = joint.coulomb_friction
    if friction is not None:  # what a log does not show is None, and a warning says why
        low, high = friction.interval95
        print(f"{name}: Coulomb friction {friction.value:.3f} N m, 95 %: {low:.3f} to {high:.3f}")

print("written:", result.save("identified") / "report.html")
