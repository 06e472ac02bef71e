"""What does adaptation do? Latents taken away and swapped, what they tell of the friction, and a monitor of wear."""
