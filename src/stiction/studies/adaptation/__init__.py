"""What a student's latent z* does, and whether it tells the friction of the joints."""
