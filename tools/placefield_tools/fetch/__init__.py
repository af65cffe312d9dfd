"""Fetching maps from another host."""
