"""Open Dynamics Engine, on which Webots' engine is based, through its C library."""
