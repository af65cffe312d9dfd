"""The built map, in memory and on disk."""
