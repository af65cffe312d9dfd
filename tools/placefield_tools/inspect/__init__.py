"""Inspecting a map."""
