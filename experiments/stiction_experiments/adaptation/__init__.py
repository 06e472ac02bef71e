"""Effect of a student's latent z* on the walk, and regression of friction on z*."""
