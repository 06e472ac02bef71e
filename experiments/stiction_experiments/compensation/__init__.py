"""Friction fed forward, as users of motors do it: following with it, and hunting at standstill."""
