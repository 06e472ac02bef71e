"""Number that says how much friction is too much: the friction at which policies stop following, on twelve axes."""
