"""Floor 4: rapid motor adaptation on rsl_rl: models, teacher, student, runner."""
