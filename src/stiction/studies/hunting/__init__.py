"""Does a robot that stands still on joints with friction move to and fro once friction is fed forward?"""
