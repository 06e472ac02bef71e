"""Which feet are down when, with and without the two gait rewards."""
