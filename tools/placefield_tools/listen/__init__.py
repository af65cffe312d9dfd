"""Reads matches from the bus."""
