"""Removal of passwords from the names of sources, before they are shown or logged."""

import re

_URL = re.compile(r"([a-z][a-z0-9+.-]+:/+)(.*)", re.IGNORECASE | re.DOTALL)


def without_secrets(where: str) -> str:
    """Return a URL without user, password and query; other text is returned unchanged.

    A password may hold characters that should be escaped, such as a slash. If it is unclear where
    the password ends, more of the URL is removed than necessary.
    """
    url = _URL.fullmatch(where)
    if url is None:
        return where
    scheme, rest = url.groups()
    address, _, query = rest.partition("?")
    return f"{scheme}…" if "@" in query else scheme + address.rpartition("@")[2]
