"""Task: commands, rewards, randomisation, and the vectorised environment."""

import os

# rsl_rl imports GitPython, which raises where no git executable is installed unless told to be quiet.
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
