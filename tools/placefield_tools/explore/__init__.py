"""Exploring a drive without a map: its services, and the map that is built of it."""
