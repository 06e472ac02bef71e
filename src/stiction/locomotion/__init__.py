"""Floor 3: the task: commands, rewards, randomisation, and the vectorised environment."""
