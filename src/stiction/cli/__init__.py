"""Floor 7: the command line. One file a verb: parse, call, print."""
