"""What a robot is, as data; how one is read from files, checked, and built in MuJoCo."""
