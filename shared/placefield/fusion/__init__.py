"""Candidates to match."""
