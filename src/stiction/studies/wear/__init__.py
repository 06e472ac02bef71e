"""How long a policy lives while friction grows, and whether its monitor notices in time."""
