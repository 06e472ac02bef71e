"""What a robot is (NumPy), and its MuJoCo model (`box_legs` alone)."""
