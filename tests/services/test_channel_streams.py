"""Shards of a channel at workers of their own, joined as the fuser joins them.

Whole channels, which are the only shard, are in ``test_channel``.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from bus_doubles import PeerCache, RecordingPublisher, header, received
from map_versions import version_of
from numpy.typing import NDArray

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelPartial,
    FinishedMessage,
    HaloMessage,
)
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import CacheQuery, FeatureMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.config import MatchingConfig, Rule
from placefield.errors import OtherMapError
from placefield.fusion.shard_joiner import ShardJoiner
from placefield.maps.map import Map, fingerprint
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import MetricPlaces
from placefield.matching.filter_matcher import FilterMatcher
from placefield.matching.sharding import ChannelShard
from placefield_services import channel_streams
from placefield_services import channel_worker as worker_module
from placefield_services.channel_streams import ChannelOutputs
from placefield_services.channel_worker import ChannelWorker
from placefield_services.served_channels import ServedChannels

SHARDS = 3
RULES: tuple[Rule, ...] = get_args(Rule)
KEYS = Keys("test")
Descriptor = NDArray[np.float32]


class Shards:
    """The workers of all shards of a map's channels, and the bus between them."""

    def __init__(self, placemap: Map, rule: Rule) -> None:
        self._map, self._rule = placemap, rule
        self.model = fingerprint(placemap.model)
        self.features = PeerCache()
        self.counts: Counter[str] = Counter()
        self.halos: dict[int, CachedPublisher] = {}
        self.partials: dict[int, RecordingPublisher] = {}
        self.answered: dict[int, RecordingPublisher] = {}
        self.workers: dict[int, ChannelWorker] = {}
        self._passed_on: dict[tuple[int, int], int] = {}
        for shard in range(SHARDS):
            self.start(shard)

    def start(self, shard: int) -> None:
        """Start a worker, or replace it."""
        self.partials[shard] = RecordingPublisher(HaloMessage)
        self.answered[shard] = RecordingPublisher(CandidatesMessage, FinishedMessage)
        self.halos[shard] = CachedPublisher(self.partials[shard], ReplayCache())
        outputs = ChannelOutputs(
            candidates=CachedPublisher(self.answered[shard], ReplayCache()),
            fetch=self.features.fetch,
            features=ReplayCache(),
            halos=self.halos[shard],
            fetch_halos=self._fetch_halos,
            counts=self.counts,
        )
        served = self._served(self._map, shard)
        served.warm_up()
        self.workers[shard] = ChannelWorker(served, {"test": outputs}, {"test": Counter()})
        self._passed_on = (
            {key: 0 for key in self._passed_on if shard not in key}
            | {(shard, other): 0 for other in range(SHARDS)}
            | {(other, shard): 0 for other in range(SHARDS)}
        )

    def _served(self, placemap: Map, shard: int) -> ServedChannels:
        channels = range(len(placemap.channels))
        return ServedChannels(placemap, channels, MatchingConfig(rule=self._rule), shard, SHARDS)

    def offer(self, version: Map, shard: int) -> None:
        """Let a worker have a new version of the map."""
        self.workers[shard].offer(self._served(version, shard))

    def _fetch_halos(self, stream: str, first: int, end: int) -> Iterator[tuple[Header, bytes]]:
        query = CacheQuery(stream=stream, first=first, end=end).encode()
        for cache in chain.from_iterable(each.caches for each in self.halos.values()):
            for payload, attachment in cache.reply(query):
                yield Header.decode(attachment), payload

    def send(self, about: Header, descriptor: Descriptor | None, shards: Iterable[int]) -> None:
        """Pass a descriptor to the workers in this order."""
        message = FeatureMessage(model=self.model, descriptor=descriptor)
        payload = b"" if about.end else message
        self.features.kept[about.sequence] = about, b"" if about.end else message.encode()
        for shard in shards:
            worker = self.workers[shard]
            worker.match([worker.accept(received(KEYS.feature, about, payload))])

    def exchange(self, *, lost: bool = False) -> None:
        """Pass all partial results on, and those that follow from them."""
        while self._pass_on(lost=lost):
            pass

    def _pass_on(self, *, lost: bool) -> bool:
        is_any_new = False
        for (sender, receiver), passed_on in list(self._passed_on.items()):
            sent = self.partials[sender].sent
            self._passed_on[sender, receiver] = len(sent)
            if sender == receiver or receiver not in self.workers or lost:
                continue
            for about, message in sent[passed_on:]:
                assert message is not None
                is_any_new = True
                halo = received(KEYS.halo(str(sender)), about, message)
                with suppress(OtherMapError):  # of a version that it has not opened yet
                    self.workers[receiver].accept(halo)
        return is_any_new

    def after_batch(self) -> None:
        for worker in self.workers.values():
            worker.after_batch("test")

    def joined(self, channel: int, of: str | None = None) -> dict[int, Candidate]:
        """Return the joined candidates of the shards, by frame, of one map or of any."""
        joiner, joined = ShardJoiner(self._rule), {}
        for shard, answered in self.answered.items():
            for about, message in answered.sent:
                if not isinstance(message, CandidatesMessage) or of not in (None, message.map):
                    continue
                (own,) = [each for each in message.candidates if each.channel == channel]
                whole = joiner.add(about.sequence, channel, shard, SHARDS, own.candidate)
                if whole is not None:
                    joined[about.sequence] = whole
        return joined


def whole(
    placemap: Map, channel: int, rule: Rule, descriptors: Sequence[Descriptor | None]
) -> list[Candidate]:
    matcher = ChannelShard(placemap.channels[channel], MatchingConfig(rule=rule)).new_matcher()
    places = MetricPlaces(placemap.channels[channel].metric, exact=True)
    return [
        matcher.update(None if one is None else next(iter(places.compare(one[None]))))
        for one in descriptors
    ]


def assert_same(joined: dict[int, Candidate], expected: Sequence[Candidate]) -> None:
    assert sorted(joined) == list(range(len(expected)))
    for sequence, candidate in enumerate(expected):
        assert joined[sequence].place == candidate.place
        assert joined[sequence].score == pytest.approx(candidate.score, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("rule", RULES)
def test_shards_that_receive_partial_results_late_and_in_any_order_answer_as_the_whole(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    shards, rng = Shards(route_map, rule), np.random.default_rng(0)
    observed = [None if s == 5 else one for s, one in enumerate(descriptors)]
    for sequence, descriptor in enumerate(observed):
        shards.send(header(sequence), descriptor, rng.permutation(SHARDS).tolist())
        if rng.random() < 0.5:
            shards.exchange()
    shards.exchange()
    for channel in (0, 2):
        assert_same(shards.joined(channel), whole(route_map, channel, rule, observed))


def test_a_frame_that_no_worker_has_is_a_missing_observation(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    shards = Shards(route_map, "filter")
    observed = [None if s in (4, 5, 6) else one for s, one in enumerate(descriptors)]
    for sequence, descriptor in enumerate(observed):
        if descriptor is not None:
            shards.send(header(sequence, live=True), descriptor, range(SHARDS))
            shards.exchange()
    expected = whole(route_map, 0, "filter", observed)
    joined = shards.joined(0)
    assert sorted(joined) == [s for s, one in enumerate(observed) if one is not None]
    assert all(joined[s].place == expected[s].place for s in joined)


def test_lost_partial_results_are_fetched(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channel_streams, "_ASK_AFTER_S", 0.0)
    shards = Shards(route_map, "filter")
    for sequence, descriptor in enumerate(descriptors):
        shards.send(header(sequence), descriptor, range(SHARDS))
        shards.exchange(lost=sequence % 3 == 1)
        shards.after_batch()
    for _ in descriptors:
        shards.after_batch()
        shards.exchange(lost=True)
    assert_same(shards.joined(0), whole(route_map, 0, "filter", descriptors))


def test_the_other_shards_wait_for_a_restarted_one_and_all_answers_are_the_same(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channel_streams, "_ASK_AFTER_S", 0.0)
    shards = Shards(route_map, "filter")
    answered = []
    for sequence, descriptor in enumerate(descriptors):
        there = [0, 2] if 6 <= sequence < 12 else range(SHARDS)
        if sequence == 6:
            answered = shards.answered[1].sent
            del shards.workers[1]
        if sequence == 12:
            shards.start(1)
        shards.send(header(sequence, oldest=min(6, sequence)), descriptor, there)
        shards.exchange()
    for _ in range(3):
        shards.after_batch()
        shards.exchange()
    shards.answered[1].sent[:0] = answered
    assert_same(shards.joined(0), whole(route_map, 0, "filter", descriptors))


def test_the_other_shards_join_one_that_was_away_for_longer_than_the_caches_last(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channel_streams, "_ASK_AFTER_S", 0.0)
    monkeypatch.setattr(channel_streams, "LENGTH", 3)
    monkeypatch.setattr(worker_module, "LENGTH", 3)
    shards = Shards(route_map, "filter")
    del shards.workers[1]
    for sequence, descriptor in enumerate(descriptors):
        if sequence == 12:
            shards.start(1)
        shards.send(header(sequence), descriptor, shards.workers)
        shards.exchange()
        shards.after_batch()
    for _ in range(3):
        shards.after_batch()
        shards.exchange()
    assert max(shards.joined(0)) == len(descriptors) - 1


def test_a_frame_that_a_shard_lost_to_a_defect_is_missing_there_and_blocks_no_other_shard(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    shards = Shards(route_map, "filter")
    for sequence, descriptor in enumerate(descriptors):
        with monkeypatch.context() as patch:
            shards.send(header(sequence), descriptor, [0, 2])
            if sequence == 6:
                patch.setattr(FilterMatcher, "local", lambda *_: 1 // 0)
            shards.send(header(sequence), descriptor, [1])
        shards.exchange()
    assert shards.answered[0].sequences == list(range(len(descriptors)))
    assert shards.answered[1].sequences == [s for s in range(len(descriptors)) if s != 6]
    expected = whole(route_map, 0, "filter", descriptors)
    assert all(joined.place == expected[s].place for s, joined in shards.joined(0).items())


def test_shards_that_open_a_new_version_one_after_the_other_answer_under_both_as_the_whole(
    route_map: Map,
    reference_dir: Path,
    descriptors: list[Descriptor],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(channel_streams, "_ASK_AFTER_S", 0.0)
    shards, version = Shards(route_map, "filter"), version_of(route_map, reference_dir, 1)
    for sequence, descriptor in enumerate(descriptors):
        if sequence in (4, 7, 11):
            shards.offer(version, {4: 2, 7: 0, 11: 1}[sequence])
        shards.send(header(sequence, oldest=max(0, sequence - 1)), descriptor, range(SHARDS))
        shards.exchange()
        shards.after_batch()
    for _ in descriptors:
        shards.after_batch()
        shards.exchange()
    assert_same(shards.joined(0, of=route_map.digest), whole(route_map, 0, "filter", descriptors))
    joined = shards.joined(0, of=version.digest)
    assert sorted(joined) == list(range(10, len(descriptors)))
    expected = whole(version, 0, "filter", descriptors)
    for sequence, candidate in joined.items():
        assert candidate.place == expected[sequence].place
        assert candidate.score == pytest.approx(expected[sequence].score, rel=1e-4, abs=1e-6)


def test_the_end_comes_after_the_last_answer(route_map: Map, descriptors: list[Descriptor]) -> None:
    shards = Shards(route_map, "filter")
    shards.send(header(0), descriptors[0], range(SHARDS))
    shards.send(header(1, end=True), None, range(SHARDS))
    assert not shards.answered[0].sent
    shards.exchange()
    assert shards.answered[0].sequences == [0, 1]
    about, finished = shards.answered[0].sent[-1]
    assert about == header(1, end=True)
    assert isinstance(finished, FinishedMessage)
    assert (finished.shard, finished.shards, finished.channels) == (0, SHARDS, (0, 1, 2))


def test_partial_results_of_another_sharding_or_map_are_refused(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    shards = Shards(route_map, "filter")
    for foreign in (2, 40):
        partial = ChannelPartial(channel=0, partial=np.zeros(foreign))
        for count in (SHARDS, SHARDS + 1):
            message = HaloMessage(map=route_map.digest, shard=1, shards=count, partials=(partial,))
            halo = received(KEYS.halo("untrusted"), header(0), message)
            shards.workers[0].accept(halo)
    shards.send(header(0), descriptors[0], range(SHARDS))
    shards.exchange()
    shards.after_batch()
    assert_same(shards.joined(0), whole(route_map, 0, "filter", descriptors[:1]))
