"""A robot whose joints are not those of the simulation that trained: it plays the real one, and tells no more."""
