"""The framework of all experiments: options, folder, parts, page."""
