"""Whether friction fed forward, as users of motors do it, makes a policy follow, and whether it hunts at standstill."""
