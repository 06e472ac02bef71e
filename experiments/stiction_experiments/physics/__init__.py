"""What a faster simulation of joint friction does to the speed of a walk."""
