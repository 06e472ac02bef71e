"""Intervals of a wear monitor that hold on virtual robots, and how often they do on others."""
