"""Segments to projection."""
