"""B and k·kd as one number to a joint: where that holds, and where it fails."""
