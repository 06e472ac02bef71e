"""Floor 2: the batched simulation behind one protocol."""
