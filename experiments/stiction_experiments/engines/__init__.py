"""Whether every engine does what it should, and how the same policy walks in each."""
