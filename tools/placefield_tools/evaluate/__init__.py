"""Evaluating how well a query is recognised."""
