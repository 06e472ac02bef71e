"""Effect of a faster simulation of joint friction on the speed of a walk."""
