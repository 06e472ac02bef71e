"""Floor 5: export of a run to a bundle, evaluation in engines, bench."""
