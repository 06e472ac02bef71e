"""A policy bundle as a Webots project: robot, worlds, controller, physics plugin. Written and tested, not run."""
