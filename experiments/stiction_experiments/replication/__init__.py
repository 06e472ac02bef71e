"""The paper's comparison over engines and a virtual robot, and the verdicts on its sentences."""
