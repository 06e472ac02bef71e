"""The batched simulation behind one protocol."""
