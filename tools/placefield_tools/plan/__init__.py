"""Which process runs on which host."""
