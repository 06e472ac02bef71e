"""Robots as data: their files, checks and MuJoCo models."""
