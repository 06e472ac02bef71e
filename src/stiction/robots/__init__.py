"""Floor 1: what a robot is (NumPy), and its MuJoCo model (`build` alone)."""
