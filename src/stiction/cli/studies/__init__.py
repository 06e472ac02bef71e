"""One file a study: parse, call, write its page."""
