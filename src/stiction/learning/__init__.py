"""Rapid motor adaptation on rsl_rl: models, teacher, student, runner."""
