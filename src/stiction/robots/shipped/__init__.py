"""Robots that come with the package, a module each with a `ROBOT`."""
