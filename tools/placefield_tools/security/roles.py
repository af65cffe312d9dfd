"""Who may do what on the bus."""

from dataclasses import dataclass

from placefield.bus.keys import ROOT, Keys

_ANY = Keys("*")
_CACHES = _ANY.all_caches
_MAPS = f"{ROOT}/maps/**"

EVERYTHING = f"{ROOT}/**"
ALL_ALIVE = _ANY.all_alive()
"""Every role may read the liveliness tokens."""


@dataclass(frozen=True)
class Role:
    """What a process of one role may do, as key expressions; all else is denied.

    Attributes:
        publishes: what it may publish on.
        reads: what it may subscribe to.
        is_alive_as: liveliness tokens that it may hold.
        asks: what it may query.
        answers: whose queries it may answer.
    """

    publishes: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    is_alive_as: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()


def _service(name: str, *, publishes: tuple[str, ...], reads: tuple[str, ...]) -> Role:
    return Role(
        publishes=(*publishes, _ANY.stats(name, "*")),
        reads=reads,
        is_alive_as=(_ANY.all_alive(name),),
        asks=(_CACHES, _MAPS),
        answers=(_CACHES,),
    )


ROLES = {
    "featurizer": _service(
        "featurizer",
        publishes=(_ANY.feature, _ANY.moments, _ANY.unobserved),
        reads=(_ANY.frame, _ANY.all_raws, _ANY.ack),
    ),
    "describer": Role(
        publishes=(_ANY.all_raws, _ANY.stats("describer", "*")),
        reads=(_ANY.frame,),
        is_alive_as=(_ANY.all_alive("describer"),),
        asks=(_MAPS,),
    ),
    "channel": _service(
        "channel",
        publishes=(_ANY.all_candidates, _ANY.all_halos),
        reads=(_ANY.feature, _ANY.moments, _ANY.all_halos, _ANY.match),
    ),
    "fuser": _service(
        "fuser",
        publishes=(_ANY.match, _ANY.smoothed, _ANY.ack),
        reads=(_ANY.feature, _ANY.moments, _ANY.all_candidates),
    ),
    "verifier": _service(
        "verifier",
        publishes=(_ANY.verified,),
        reads=(_ANY.frame, _ANY.smoothed, _ANY.verified),
    ),
    "mapper": Role(
        publishes=(_ANY.stats("mapper", "*"),),
        reads=(_ANY.frame, _ANY.feature),
        is_alive_as=(_ANY.all_alive("mapper"),),
        asks=(_CACHES,),
        answers=(_CACHES,),
    ),
    "camera": Role(
        publishes=(_ANY.frame, _ANY.odometry),
        reads=(_ANY.match, _ANY.ack, _ANY.unobserved, _ANY.odometry),
        is_alive_as=(_ANY.all_alive("replay"),),
    ),
    "dashboard": Role(reads=(EVERYTHING,), asks=(_CACHES,)),
    "mapserver": Role(
        publishes=(_ANY.stats("mapserver", "*"),),
        is_alive_as=(_ANY.all_alive("mapserver"),),
        answers=(_MAPS,),
    ),
}
"""The roles of clients. A router may do everything: it passes on what others do."""

ROUTER = "router"
