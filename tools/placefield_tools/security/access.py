"""The access control of a router, as Zenoh has it: by the common name of a client's certificate."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from placefield_tools.security.roles import ALL_ALIVE, EVERYTHING, ROUTER, Role

_Flow = Literal["ingress", "egress"]  # from the client, and to it

_MESSAGES = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def access_control(roles: Mapping[str, Role]) -> dict[str, Any]:
    """Return the section ``access_control`` of a router's configuration; what it omits is denied.

    Args:
        roles: of clients, by the common name of their certificates. A router may do everything.
    """
    rules = {name: _rules(name, role) for name, role in roles.items()}
    rules[ROUTER] = [
        _rule(f"{ROUTER} to {ROUTER}", ("ingress", "egress"), _MESSAGES, ("**",)),
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for own in rules.values() for rule in own],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in rules],
        "policies": [
            {"rules": [rule["id"] for rule in own], "subjects": [name]}
            for name, own in rules.items()
        ],
    }


def _rules(name: str, role: Role) -> list[dict[str, Any]]:
    """Return what a role may send and what is sent to it.

    A client publishes only to keys that the router declares as subscribed, and queries only keys
    declared as queryable. So every client receives these declarations.
    """
    to_router = {
        ("put",): role.publishes,
        ("declare_subscriber",): role.reads,
        ("liveliness_token",): role.is_alive_as,
        ("liveliness_query", "declare_liveliness_subscriber"): (ALL_ALIVE,),
        ("query",): role.asks,
        ("declare_queryable", "reply"): role.answers,
    }
    from_router = {
        ("put",): role.reads,
        ("liveliness_token",): (ALL_ALIVE,),
        ("reply",): role.asks,
        ("query",): role.answers,
        ("declare_subscriber", "declare_queryable"): (EVERYTHING,),
    }
    return [
        *_flow(f"{name} sends", "ingress", to_router),
        *_flow(f"{name} gets", "egress", from_router),
    ]


def _flow(
    prefix: str, flow: _Flow, granted: Mapping[tuple[str, ...], Sequence[str]]
) -> list[dict[str, Any]]:
    return [
        _rule(f"{prefix} {' and '.join(messages)}", (flow,), messages, keys)
        for messages, keys in granted.items()
        if keys
    ]


def _rule(
    name: str, flows: Sequence[_Flow], messages: Sequence[str], keys: Sequence[str]
) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(keys),
    }
