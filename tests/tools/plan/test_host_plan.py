import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield_tools.plan.host_plan import LEAST_SHARD, ROOM, Plan, plan, with_describers
from placefield_tools.plan.process_cost import MetricLoad, Process, worker_of

SERVICES = [Process("featurizer", 5e-3), Process("fuser", 2e-3)]


def made_loads(places: int, channels: Sequence[int], *, read: int = 600) -> list[MetricLoad]:
    """Return metrics of so many channels each, whose places have so many bytes."""
    loads, first = [], 0
    for count in channels:
        own = tuple(range(first, first + count))
        loads.append(MetricLoad(own, places * read, 360_000, places * (read + 12)))
        first += count
    return loads


def workers_of(made: Plan) -> list[Process]:
    return [each for host in made.hosts for each in host if each.service == "channel"]


any_map = st.tuples(
    st.sampled_from([60, 10_000, 20_000, 99_999, 1_000_000]),
    st.lists(st.integers(1, 4), min_size=1, max_size=6),
)


@given(any_map, st.integers(1, 5), st.integers(1, 8), st.floats(1, 1000))
def test_every_channel_is_placed_once_in_shards_of_one_cut(
    made: tuple[int, list[int]], hosts: int, cores: int, rate: float
) -> None:
    places, channels = made
    placed = plan(
        made_loads(places, channels), SERVICES, places, hosts=hosts, cores=cores, rate=rate
    )
    workers = workers_of(placed)
    for channel in range(sum(channels)):
        own = [worker for worker in workers if channel in worker.channels]
        assert {worker.shards for worker in own} == {len(own)}
        assert sorted(worker.shard for worker in own) == [*range(len(own))]
        assert len(own) == 1 or places // len(own) >= LEAST_SHARD


@given(any_map, st.integers(1, 5), st.integers(1, 8), st.floats(1, 1000))
def test_nothing_goes_beyond_the_cores_and_each_service_is_where_it_belongs(
    made: tuple[int, list[int]], hosts: int, cores: int, rate: float
) -> None:
    places, channels = made
    placed = plan(
        made_loads(places, channels), SERVICES, places, hosts=hosts, cores=cores, rate=rate
    )
    assert len(placed.hosts) == hosts
    for number, processes in enumerate(placed.hosts):
        services = [process.service for process in processes]
        assert services.count("channel") <= cores
        assert services.count("router") == 1
        assert services.count("featurizer") == services.count("fuser") == (number == 0)
        assert services[0] == "router"
        # The cores of a host cannot do less together than what it has to do.
        assert placed.busiest_s * cores >= sum(process.frame_s for process in processes) - 1e-12
    assert placed.busiest_s >= max(p.frame_s for host in placed.hosts for p in host)


@given(any_map, st.integers(1, 3), st.integers(1, 4), st.floats(1, 200))
def test_channels_of_one_metric_stay_together(
    made: tuple[int, list[int]], hosts: int, cores: int, rate: float
) -> None:
    places, channels = made
    loads = made_loads(places, channels)
    for worker in workers_of(plan(loads, SERVICES, places, hosts=hosts, cores=cores, rate=rate)):
        for load in loads:
            together = set(load.channels) & set(worker.channels)
            assert together in (set(), set(load.channels))


@settings(max_examples=40)
@given(
    st.sampled_from([20_000, 100_000, 400_000]),
    st.lists(st.integers(1, 4), min_size=1, max_size=4),
    st.integers(1, 6),
)
def test_the_costliest_worker_is_within_a_third_of_the_best_there_is(
    places: int, channels: list[int], cores: int
) -> None:
    """Try all partitions of the metrics into groups and shards, without other services."""
    loads = made_loads(places, channels)
    placed = plan(loads, [], places, hosts=1, cores=cores, rate=1e6)
    best = min(
        max(
            worker_of(
                [load for load, own in zip(loads, assigned, strict=True) if own == group],
                cut,
                places,
            ).frame_s
            for group, cut in enumerate(cuts)
        )
        for groups in range(1, min(len(loads), cores) + 1)
        for assigned in product(range(groups), repeat=len(loads))
        for cuts in product(range(1, cores + 1), repeat=groups)
        if sum(cuts) <= cores and all(cut == 1 or places // cut >= LEAST_SHARD for cut in cuts)
    )
    assert max(worker.frame_s for worker in workers_of(placed)) <= 4 / 3 * best + 1e-12


def test_a_small_map_is_one_worker_however_many_hosts_there_are() -> None:
    placed = plan(made_loads(1261, [4]), SERVICES, 1261, hosts=4, cores=8, rate=30)
    assert [(worker.channels, worker.shards) for worker in workers_of(placed)] == [
        ((0, 1, 2, 3), 1)
    ]
    assert placed.suffices(30)


def test_a_channel_is_cut_only_where_a_core_cannot_do_it_at_the_rate() -> None:
    places = 100_000
    loads = made_loads(places, [1, 1, 1, 1])
    [alone] = workers_of(plan(loads[:1], [], places, hosts=1, cores=1, rate=1))
    most = ROOM / alone.frame_s  # of a core
    for rate, shards in ((0.99 * most, 1), (1.2 * most, 2)):
        placed = plan(loads, SERVICES, places, hosts=3, cores=8, rate=rate)
        assert {worker.shards for worker in workers_of(placed)} == {shards}
        assert placed.suffices(rate)


def test_what_no_hosts_can_do_is_said() -> None:
    places = 1_000_000
    placed = plan(made_loads(places, [1] * 4), SERVICES, places, hosts=1, cores=2, rate=30)
    assert not placed.suffices(30)
    assert placed.highest_rate < 30
    assert len(workers_of(placed)) == 2


def test_a_channel_is_cut_where_a_host_has_not_the_memory_for_it() -> None:
    places, rate, ample = 1_000_000, 1.0, 10e9
    loads = made_loads(places, [1])

    def planned(hosts: int, memory_bytes: float) -> Plan:
        return plan(
            loads, SERVICES, places, hosts=hosts, cores=2, rate=rate, memory_bytes=memory_bytes
        )

    [whole] = workers_of(planned(4, ample))
    assert whole.mapped_bytes == loads[0].mapped_bytes > 0.6e9
    cut = planned(4, 0.9e9)
    assert cut.suffices(rate, 0.9e9)
    assert len(workers_of(cut)) > 1
    assert max(cut.memory_bytes) <= 0.9e9
    too_small = planned(1, 0.9e9)
    assert too_small.has_time(rate)
    assert not too_small.suffices(rate, 0.9e9)
    assert too_small.memory_bytes[0] > 0.9e9


@given(any_map, st.integers(1, 4), st.integers(1, 4), st.floats(0.1, 4))
def test_ample_memory_changes_nothing_and_scarce_memory_makes_no_host_need_more(
    made: tuple[int, list[int]], hosts: int, cores: int, gigabytes: float
) -> None:
    places, channels = made
    loads, memory_bytes = made_loads(places, channels), gigabytes * 1e9

    def planned(limit: float) -> Plan:
        return plan(
            loads, SERVICES, places, hosts=hosts, cores=cores, rate=1e-3, memory_bytes=limit
        )

    free, bound = planned(math.inf), planned(memory_bytes)
    assert max(bound.memory_bytes) <= max(*free.memory_bytes, memory_bytes)
    if max(free.memory_bytes) <= memory_bytes:
        assert bound == free


def test_two_large_workers_go_to_two_hosts_where_one_has_not_the_memory_for_both() -> None:
    loads = [MetricLoad((channel,), 900_000_000, 1000, 1_000_000_000) for channel in range(2)]
    placed = plan(loads, SERVICES, 15_000, hosts=2, cores=2, rate=5, memory_bytes=1.7e9)
    assert placed.suffices(5, 1.7e9)
    assert sorted(channel for worker in workers_of(placed) for channel in worker.channels) == [0, 1]


def test_what_takes_most_memory_is_cut_though_another_takes_most_time() -> None:
    places, memory_bytes = 20_000, 1.5e9
    large = MetricLoad((0,), 10_000_000, 0, 2_000_000_000)
    slow = MetricLoad((1,), 100_000_000, 0, 100_000_000)
    placed = plan(
        [large, slow], SERVICES, places, hosts=2, cores=2, rate=5, memory_bytes=memory_bytes
    )
    assert placed.suffices(5, memory_bytes)
    assert [(worker.channels, worker.shards) for worker in workers_of(placed)].count(((0,), 2)) == 2


def least_bytes(loads: Sequence[MetricLoad], hosts: int, cores: int, rate: float) -> int | None:
    """Return the memory that hosts need for a worker of each metric, of all ways to place them.

    With more than one core the rate has to be one that a core could do with all of them.
    """
    [*beside] = plan(loads[:1], SERVICES, 60, hosts=hosts, cores=cores, rate=rate).hosts
    others = [[each for each in host if each.service != "channel"] for host in beside]
    workers = [workers_of(plan([load], [], 60, hosts=1, cores=1, rate=rate))[0] for load in loads]
    ways = []
    for way in product(range(hosts), repeat=len(workers)):
        on = [list(processes) for processes in others]
        for worker, host in zip(workers, way, strict=True):
            on[host].append(worker)
        has_time = max(sum(each.frame_s for each in host) for host in on) * rate <= ROOM
        if has_time and max(way.count(host) for host in way) <= cores:
            ways.append(max(sum(each.own_bytes + each.mapped_bytes for each in h) for h in on))
    return min(ways, default=None)


any_bytes = st.integers(1, 20).map(lambda count: count * 100_000_000)


@given(
    st.integers(1, 4),
    st.lists(st.tuples(any_bytes, any_bytes), min_size=1, max_size=4),
    st.sampled_from([0.1, 5.0, 10.0, 20.0, 50.0]),
)
def test_with_a_core_a_host_it_suffices_where_any_placement_of_whole_workers_does(
    hosts: int, takes: list[tuple[int, int]], rate: float
) -> None:
    loads = [
        MetricLoad((number,), read, 0, mapped)
        for number, (read, mapped) in enumerate(takes[:hosts])
    ]
    memory_bytes = least_bytes(loads, hosts, 1, rate)
    if memory_bytes is not None:
        placed = plan(
            loads, SERVICES, 60, hosts=hosts, cores=1, rate=rate, memory_bytes=memory_bytes
        )
        assert placed.suffices(rate, memory_bytes)


@given(st.integers(1, 3), st.integers(2, 3), st.lists(any_bytes, min_size=1, max_size=5))
def test_with_more_cores_it_suffices_where_a_placement_takes_three_quarters_of_the_memory(
    hosts: int, cores: int, sizes: list[int]
) -> None:
    loads = [
        MetricLoad((number,), 0, 0, size) for number, size in enumerate(sizes[: hosts * cores])
    ]
    rate = 0.1
    least = least_bytes(loads, hosts, cores, rate)
    assert least is not None
    placed = plan(
        loads, SERVICES, 60, hosts=hosts, cores=cores, rate=rate, memory_bytes=4 / 3 * least
    )
    assert placed.suffices(rate, 4 / 3 * least)


def test_memory_follows_the_places_that_a_worker_has() -> None:
    places = 400_000
    loads = made_loads(places, [1])
    [whole] = workers_of(plan(loads, SERVICES, places, hosts=1, cores=1, rate=30))
    cut = workers_of(plan(loads, SERVICES, places, hosts=1, cores=4, rate=1000))
    assert whole.mapped_bytes == loads[0].mapped_bytes
    assert len(cut) > 1
    assert {worker.mapped_bytes for worker in cut} == {loads[0].mapped_bytes // len(cut)}
    # 2 x 16 float32 beliefs of each place are the least that a metric's channels hold.
    assert whole.own_bytes - cut[0].own_bytes >= (1 - 1 / len(cut)) * places * 2 * 16 * 4


@pytest.mark.parametrize(("rate", "describers"), [(20, 0), (30, 1), (60, 2), (1e6, 7)])
def test_there_are_as_many_describers_as_the_rate_needs_and_no_more(
    rate: float, describers: int
) -> None:
    services = [Process("featurizer", 31e-3), Process("fuser", 2e-3)]
    found = Counter(each.service for each in with_describers(services, rate, most=7))
    assert found == Counter({"featurizer": 1, "fuser": 1, "describer": describers})
    placed = plan(
        made_loads(60, [4]), with_describers(services, rate, 7), 60, hosts=2, cores=4, rate=rate
    )
    assert placed.has_time(rate) == (rate < 100)
    on = [sum(each.service == "describer" for each in host) for host in placed.hosts]
    assert on == [describers // 2, (describers + 1) // 2]


def test_a_feature_that_is_fast_enough_or_given_needs_no_describer() -> None:
    for featurizer_s, rate in ((5e-3, 30), (1e-3, 1e6), (1e-4, 1e6)):
        services = [Process("featurizer", featurizer_s), Process("fuser", 2e-3)]
        assert with_describers(services, rate, most=7) == services


def test_a_map_with_lists_is_not_cut_however_large_it_is() -> None:
    """Shards have beliefs of all places."""
    for places in (10**6, 10**7):
        [dense] = made_loads(places, [4])
        listed = replace(dense, has_lists=True)
        for load, is_cut in ((dense, True), (listed, False)):
            placed = plan([load], SERVICES, places, hosts=1, cores=8, rate=25)
            workers = workers_of(placed)
            assert (len(workers) > 1) == is_cut
            assert (workers[0].own_bytes > SERVICES[0].own_bytes) == is_cut
        assert placed.has_time(25)
