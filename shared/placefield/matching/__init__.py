"""Descriptor stream to candidate."""
