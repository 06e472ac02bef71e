"""Friction fed forward, as users of motors do it: does a policy follow with it, and does it hunt at standstill?"""
