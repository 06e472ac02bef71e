"""Physics engines in which one robot walks: the one trained in and others, behind one small interface."""
