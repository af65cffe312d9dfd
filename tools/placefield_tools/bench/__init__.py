"""Benchmarks: our way against the plain one."""
