"""Replaying a source of frames to the bus."""
