"""Fetching from hosts that are there in part, wrong or hostile; the bus is a stand-in."""

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from placefield.bus.maps import MapKeys, OfferMessage, chunk_of
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.errors import BusError, MapError, MessageError
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.transfer import CHUNK, OwnMap, digest_of
from placefield_services.mapserver import MapAnswers
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.fetch.map_download import Fetch

KEYS = MapKeys("route")
HURRIED = BusConfig(connect_timeout_s=0.6)

Reply = tuple[bytes, bytes]
Change = Callable[[str, Reply], list[Reply]]


class Hosts(Bus):
    """A bus whose other end are map servers; ``change`` says what becomes of their replies."""

    def __init__(self, change: Change | None = None) -> None:
        self.counts: Counter[str] = Counter()
        self.servers: dict[str, MapAnswers] = {}
        self.asked: list[str] = []
        self.change = change

    def serve(self, identity: str, path: Path) -> None:
        self.servers[identity] = MapAnswers(OwnMap(path), identity, [self.counts])

    def ask(self, key: str, payload: bytes = b"", *, timeout_s: float) -> Iterator[Reply]:
        self.asked.append(key)
        for reply in self._answers(key):
            yield from self.change(key, reply) if self.change else [reply]

    def _answers(self, key: str) -> list[Reply]:
        if key == KEYS.manifest:
            return [reply for own in self.servers.values() for reply in own.offer(key, b"")]
        server = self.servers.get(key.split("/")[3])
        try:
            return server.chunk(key, b"") if server else []
        except MessageError:
            return []

    @property
    def chunks_asked(self) -> list[str]:
        return [key for key in self.asked if key != KEYS.manifest]


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "there" / "route.pfmap"


@pytest.fixture
def hosts(map_path: Path) -> Hosts:
    hosts = Hosts()
    hosts.serve("a1", map_path)
    return hosts


@pytest.fixture(scope="module")
def other_path(made_up: Path, reference_dir: Path) -> Path:
    """Another map of the same name."""
    config = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})
    path = made_up / "other" / "route.pfmap"
    save_map(build_from([str(reference_dir)], config), path)
    return path


def fetch(hosts: Hosts, target: Path, stop: threading.Event | None = None) -> bool:
    """Fetch the map; return whether it was there."""
    own = Fetch(hosts, "route", HURRIED, stop or threading.Event())
    return own.into(target, lambda there, total: None)[1]


def refusal(hosts: Hosts, target: Path, stop: threading.Event | None = None) -> str:
    with pytest.raises((BusError, MapError)) as refused:
        fetch(hosts, target, stop)
    assert "\n" not in str(refused.value)
    assert not target.exists()
    return str(refused.value)


def same(one: Path, other: Path) -> bool:
    files = [{f.relative_to(p): f.read_bytes() for f in p.rglob("*.*")} for p in (one, other)]
    return files[0] == files[1]


def test_a_map_is_fetched_once(hosts: Hosts, map_path: Path, target: Path) -> None:
    assert not fetch(hosts, target)
    assert same(target, map_path)
    assert hosts.counts["chunks"] == OwnMap(map_path).offer().chunks
    hosts.asked.clear()
    assert fetch(hosts, target)
    assert hosts.asked == [KEYS.manifest]


def test_progress_is_reported_all_chunks(hosts: Hosts, map_path: Path, target: Path) -> None:
    reported: list[tuple[int, int]] = []
    fetching = Fetch(hosts, "route", HURRIED, threading.Event())
    fetching.into(target, lambda there, total: reported.append((there, total)))
    chunks = OwnMap(map_path).offer().chunks
    assert reported == [(there, chunks) for there in range(chunks + 1)]


def test_of_several_hosts_one_sends_each_chunk(hosts: Hosts, map_path: Path, target: Path) -> None:
    hosts.serve("b2", map_path)
    fetch(hosts, target)
    assert len(hosts.chunks_asked) == len(set(hosts.chunks_asked))
    assert hosts.counts["chunks"] == OwnMap(map_path).offer().chunks


def test_when_one_host_goes_another_goes_on(hosts: Hosts, map_path: Path, target: Path) -> None:
    def go_after_five(key: str, reply: Reply) -> list[Reply]:
        if len(hosts.chunks_asked) == 5:
            del hosts.servers["a1"]
            hosts.serve("b2", map_path)
        return [reply]

    hosts.change = go_after_five
    fetch(hosts, target)
    assert same(target, map_path)
    assert hosts.counts["chunks"] == OwnMap(map_path).offer().chunks


def test_where_nobody_has_it_one_line_says_so(target: Path) -> None:
    assert refusal(Hosts(), target) == (
        "route: nothing has come for 0.6 s: no host that has it answers; start 'placefield serve "
        "route.pfmap' where it is; then the same command goes on where this one ended"
    )
    assert list(target.parent.iterdir()) == []


def test_a_host_that_goes_for_good_leaves_what_has_come_for_the_next_time(
    hosts: Hosts, map_path: Path, target: Path
) -> None:
    def go_after_five(key: str, reply: Reply) -> list[Reply]:
        if len(hosts.chunks_asked) == 5:
            hosts.servers.clear()
        return [reply]

    hosts.change = go_after_five
    assert "nothing has come for 0.6 s: the host that has it does not answer" in refusal(
        hosts, target
    )
    again = Hosts()
    again.serve("c3", map_path)
    fetch(again, target)
    assert same(target, map_path)
    assert again.counts["chunks"] == OwnMap(map_path).offer().chunks - 5


def test_one_who_stops_it_is_reported_how_to_go_on(hosts: Hosts, target: Path) -> None:
    stop = threading.Event()

    def stop_after_five(key: str, reply: Reply) -> list[Reply]:
        if len(hosts.chunks_asked) == 5:
            stop.set()
        return [reply]

    hosts.change = stop_after_five
    assert "stopped; the same command goes on" in refusal(hosts, target, stop)
    assert len(hosts.chunks_asked) == 5


@pytest.mark.parametrize(
    "damage",
    [
        lambda data, digest: (data[:-1] + b"\0", digest),
        lambda data, digest: (data, b"0" * 64),
        lambda data, digest: (data, b""),
        lambda data, digest: (data[:-1], digest_of(data[:-1]).encode()),
        lambda data, digest: (data + b"x", digest_of(data + b"x").encode()),
        lambda data, digest: (bytes(2 * CHUNK), digest_of(bytes(2 * CHUNK)).encode()),
        lambda data, digest: (b"", digest_of(b"").encode()),
    ],
    ids=["bytes", "digest", "no digest", "short", "long", "huge", "empty"],
)
def test_a_chunk_that_does_not_check_out_is_not_taken(
    hosts: Hosts, target: Path, damage: Callable[[bytes, bytes], Reply]
) -> None:
    hosts.change = lambda key, reply: [reply if key == KEYS.manifest else damage(*reply)]
    assert "what comes is damaged" in refusal(hosts, target)
    arrived = target.with_name("route.pfmap.partial")
    assert [file.name for file in arrived.rglob("*.npy")] == []


def test_a_untrusted_client_who_answers_beside_the_host_is_not_accepted(
    hosts: Hosts, map_path: Path, target: Path
) -> None:
    hosts.change = lambda key, reply: [(b"\xc1", b"\xc1"), (reply[0], b"{}"), reply]
    fetch(hosts, target)
    assert same(target, map_path)


def test_wrong_bytes_with_their_own_digest_never_become_a_map(hosts: Hosts, target: Path) -> None:
    def forge(key: str, reply: Reply) -> list[Reply]:
        if key == KEYS.manifest or chunk_of(key)[1] != "channels/0/labels.npy":
            return [reply]
        forged = reply[0][:-1] + bytes([reply[0][-1] ^ 1])
        return [(forged, digest_of(forged).encode())]

    hosts.change = forge
    assert "channels/0/labels.npy arrives with a wrong checksum" in refusal(hosts, target)


@pytest.mark.parametrize("name", ["../../evil.npy", "/tmp/evil.npy", "places/../../evil.npy"])
def test_a_manifest_that_leads_out_of_the_folder_is_refused_before_anything_is_asked_for(
    hosts: Hosts, target: Path, tmp_path: Path, name: str
) -> None:
    def lead_out(key: str, reply: Reply) -> list[Reply]:
        about = OfferMessage.decode(reply[1])
        written = reply[0].replace(b"places/stamps.npy", name.encode())
        sizes = {of.replace("places/stamps.npy", name): size for of, size in about.sizes.items()}
        return [(written, OfferMessage(server=about.server, sizes=sizes).encode())]

    hosts.change = lead_out
    assert "what is offered is refused" in refusal(hosts, target)
    assert hosts.chunks_asked == []
    assert list(tmp_path.rglob("evil*")) == []


def test_a_map_of_a_size_that_no_disk_has_is_refused_before_anything_is_asked_for(
    hosts: Hosts, target: Path
) -> None:
    def boast(key: str, reply: Reply) -> list[Reply]:
        about = OfferMessage.decode(reply[1])
        sizes = dict.fromkeys(about.sizes, 2**48 - 1)
        return [(reply[0], OfferMessage(server=about.server, sizes=sizes).encode())]

    hosts.change = boast
    assert "MiB are still missing" in refusal(hosts, target)
    assert hosts.chunks_asked == []


def test_two_maps_of_one_name_are_never_mixed(hosts: Hosts, other_path: Path, target: Path) -> None:
    hosts.serve("b2", other_path)
    assert "hosts have different maps of this name" in refusal(hosts, target)
    assert hosts.chunks_asked == []


def test_a_map_that_is_built_again_meanwhile_is_fetched_anew(
    map_path: Path, other_path: Path, target: Path, tmp_path: Path
) -> None:
    served = tmp_path / "served" / "route.pfmap"
    save_map(open_map(map_path), served)
    hosts = Hosts()
    hosts.serve("a1", served)

    def build_after_five(key: str, reply: Reply) -> list[Reply]:
        if len(hosts.chunks_asked) == 5 and key != KEYS.manifest:
            save_map(open_map(other_path), served)
        return [reply]

    hosts.change = build_after_five
    fetch(hosts, target)
    assert same(target, other_path)


def test_another_map_in_the_way_is_left_alone(hosts: Hosts, other_path: Path, target: Path) -> None:
    save_map(open_map(other_path), target)
    with pytest.raises(MapError, match="is not the offered map; remove it"):
        fetch(hosts, target)
    assert same(target, other_path)
    assert [path.name for path in target.parent.iterdir()] == ["route.pfmap"]
