"""Conversion of our results for other simulators and trainers, and of policies between formats."""
