"""What of a source's name may be shown and logged."""

import re

_URL = re.compile(r"([a-z][a-z0-9+.-]+:/+)(.*)", re.IGNORECASE | re.DOTALL)


def without_secrets(where: str) -> str:
    """Return a URL without user, password and query; what is no URL comes as it is.

    A password may hold what ends a login elsewhere, as a slash: people type it as it is. So where
    that leaves a doubt, more is left out than need be.
    """
    url = _URL.fullmatch(where)
    if url is None:
        return where
    scheme, rest = url.groups()
    plain, _, query = rest.partition("?")
    return f"{scheme}…" if "@" in query else scheme + plain.rpartition("@")[2]
