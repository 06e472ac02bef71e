"""What a student's latent z* does, and whether friction can be read from it."""
