"""The paper's comparison: its methods and a user's, in other engines and on a virtual robot, and its sentences."""
