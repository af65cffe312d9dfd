"""A small route, drawn twice: by day and at dusk."""
