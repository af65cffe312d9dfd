"""Exporting recorded matches: pose graphs, trajectories and geographic formats."""
