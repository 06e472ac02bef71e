"""Robot under torques in several physics engines, behind one interface."""
