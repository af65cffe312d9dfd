"""A run in the browser: what it sees, what it answers, and how its services are."""
