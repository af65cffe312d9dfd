"""Starting all services of a host."""
