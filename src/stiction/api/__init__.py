"""The public functions of `stiction`, and the results that they return. The verbs of the command line call them too."""
