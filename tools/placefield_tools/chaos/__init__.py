"""Faults made on purpose: what a running system must outlive."""
