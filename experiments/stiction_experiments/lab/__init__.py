"""The framework of all experiments: options, folder, parts, claims, page."""
