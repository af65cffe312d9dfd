"""Benchmarks: Placefield beside naive implementations."""
