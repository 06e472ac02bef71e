"""What an engine must do before a result from it counts: one module a question, each returning measured figures."""
