"""The Open Dynamics Engine, the family of Webots' own, through its C library."""
