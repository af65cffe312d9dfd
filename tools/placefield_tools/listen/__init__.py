"""Matches off the bus."""
