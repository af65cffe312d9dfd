"""A summary of a map as text, and its segments as an image."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from placefield.maps.linking import overlaps
from placefield.maps.map import Map
from placefield_tools.inspect.map_facts import map_facts, traverse_line
from placefield_tools.inspect.route_facts import route_lines
from placefield_tools.plots import (
    AlignedTraverse,
    ChannelSegments,
    DrawnNetwork,
    plot_alignment,
    plot_network,
    plot_segments,
)


def print_map(opened: Map, path: Path) -> None:
    """Print the facts about a map, its routes and links, and a table of its channels."""
    console = Console(markup=False)  # a path may hold brackets
    size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    facts = {"map": f"{path}, {size / 2**20:.1f} MB", **map_facts(opened)}
    for name, fact in facts.items():
        console.print(f"{name:>10}  {fact}", highlight=False, soft_wrap=True)
    for line in route_lines(opened):
        console.print(line, highlight=False, soft_wrap=True)
    table = Table("channel", "fuzzifier", "clusters", "segments", "active", "metric", "scales")
    for number, channel in enumerate(opened.channels):
        table.add_row(
            str(number),
            f"{channel.fuzzifier:.2f}",
            str(channel.clusters),
            str(len(channel.segments)),
            f"{np.mean(channel.labels > 0):.0%}",
            "learned" if channel.metric.learned else "identity",
            " ".join(map(str, channel.scales)),
        )
    console.print(table)


def segments_of(opened: Map) -> list[ChannelSegments]:
    """Return the segments of each channel in the form of the plots."""
    return [
        ChannelSegments(
            name=f"channel {number}",
            fuzzifier=channel.fuzzifier,
            label=channel.labels,
            active=channel.labels > 0,
        )
        for number, channel in enumerate(opened.channels)
    ]


def draw_segments(opened: Map, path: Path) -> None:
    """Draw the segments of each channel over the places (the paper's figures 5, 7 and 11)."""
    plot_segments(path, segments_of(opened), opened.places.count)


def draw_alignment(opened: Map, path: Path) -> None:
    """Draw the place that each frame of the other traverses shows; the map has at least one."""
    traverses = [
        AlignedTraverse(traverse_line(opened.traverses[number]), alignment.places)
        for number, alignment in opened.alignments.items()
    ]
    plot_alignment(path, traverses, opened.places.count)


def draw_network(opened: Map, path: Path) -> None:
    """Draw the routes of a map of several, and the links between them."""
    places = opened.places
    positions = places.poses[:, :2]
    if not np.isfinite(positions).all():
        positions = np.empty((0, 2))
    shared = overlaps(places.same, opened.graph.first)
    plot_network(path, DrawnNetwork(opened.graph, shared, positions, places.count))
