import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.keys import Keys
from placefield.bus.maps import MapKeys, OfferMessage, chunk_of
from placefield.errors import MessageError

DIGEST = "0123456789abcdef" * 4
NAMES = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1)


@given(NAMES)
def test_every_name_of_a_map_makes_keys_of_its_own(name: str) -> None:
    keys, other = MapKeys(name), MapKeys(name + "*")
    served = zenoh.KeyExpr(keys.chunks("12ab"))
    chunk = keys.chunk("12ab", DIGEST, "places/stamps.npy", 7)
    assert str(zenoh.KeyExpr(keys.manifest)) == keys.manifest
    assert served.includes(zenoh.KeyExpr(chunk))
    assert not served.includes(zenoh.KeyExpr(keys.chunk("12", DIGEST, "places/stamps.npy", 7)))
    assert not served.intersects(zenoh.KeyExpr(keys.manifest))
    assert not zenoh.KeyExpr(other.manifest).intersects(zenoh.KeyExpr(keys.manifest))
    assert not served.intersects(zenoh.KeyExpr(Keys("maps").all_alive()))


@given(NAMES, st.integers(0, 10**12 - 1))
def test_a_chunk_is_read_back_from_its_key(name: str, number: int) -> None:
    key = MapKeys(name).chunk("12ab", DIGEST, "metrics/0/coarse/axes.npy", number)
    assert chunk_of(key) == (DIGEST, "metrics/0/coarse/axes.npy", number)


@pytest.mark.parametrize(
    "rest",
    [
        "**",
        "",
        DIGEST,
        f"{DIGEST}/places/stamps.npy",
        f"{DIGEST}/places/stamps.npy/-1",
        f"{DIGEST}/places/stamps.npy/1.5",
        f"{DIGEST}/places/stamps.npy/{10**12}",
        f"{DIGEST}/places/stamps.npy/١",
        f"{DIGEST[1:]}/places/stamps.npy/0",
        f"{DIGEST}/{'a' * 1001}/0",
        f"{DIGEST}/places\nstamps.npy/0",
    ],
)
def test_a_malformed_key_of_a_chunk_is_refused_in_one_line(rest: str) -> None:
    with pytest.raises(MessageError) as refused:
        chunk_of(f"placefield/maps/route/12ab/{rest}")
    assert "\n" not in str(refused.value)


@given(st.text())
def test_any_key_is_a_chunk_or_refused(key: str) -> None:
    with pytest.raises(MessageError):
        chunk_of(key)


@pytest.mark.parametrize(
    "changes",
    [
        {"server": "**"},
        {"server": "a/b"},
        {"server": ""},
        {"server": "a" * 33},
        {"sizes": {"a/b.npy": 0}},
        {"sizes": {"a/b.npy": 2**48}},
        {"sizes": {"a/b.npy": -1}},
    ],
    ids=repr,
)
def test_an_offer_that_is_out_of_bounds_does_not_parse(changes: dict[str, object]) -> None:
    good = OfferMessage(server="12ab", sizes={"a/b.npy": 1})
    assert OfferMessage.decode(good.encode()) == good
    with pytest.raises(MessageError):
        OfferMessage.decode(good.model_copy(update=changes).encode())
