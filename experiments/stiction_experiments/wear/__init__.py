"""How long a policy follows while friction grows, and whether its monitor notices in time."""
