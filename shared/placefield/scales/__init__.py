"""Reference traverse to segments."""
