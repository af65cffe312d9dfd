"""How well a query is recognised."""
