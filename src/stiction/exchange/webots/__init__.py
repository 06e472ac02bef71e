"""A bundle as a Webots project (not run in Webots)."""
