"""Recorded matches for other programs: pose graphs, trajectories, and maps of the earth."""
