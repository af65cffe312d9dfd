"""The board: it asks Prometheus for what services report."""

import json
import re
from pathlib import Path

import pytest
import yaml

import placefield.bus
import placefield.fusion
import placefield_services

GRAFANA = Path(__file__).resolve().parents[2] / "deploy" / "grafana"
METRICS = {
    "placefield_events_total",
    "placefield_newest_frame",
    "process_resident_memory_bytes",
    "process_cpu_seconds_total",
}


@pytest.fixture
def expressions() -> list[str]:
    board = json.loads((GRAFANA / "placefield.json").read_text())
    return [target["expr"] for panel in board["panels"] for target in panel["targets"]]


def test_it_asks_for_metrics_that_there_are(expressions: list[str]) -> None:
    asked = {
        name
        for expression in expressions
        for name in re.findall(r"\b(?:placefield|process)_[a-z_]+", expression)
    }
    assert asked == METRICS


def test_it_asks_for_events_that_are_counted(expressions: list[str]) -> None:
    source = "".join(
        file.read_text()
        for package in (placefield_services, placefield.bus, placefield.fusion)
        for file in Path(package.__path__[0]).glob("*.py")
    )
    asked = {
        event
        for expression in expressions
        for events in re.findall(r'event=~?"([a-z_|]+)"', expression)
        for event in events.split("|")
    }
    assert len(asked) > 10
    assert not {event for event in asked if f'"{event}"' not in source}


def test_panels_neither_overlap_nor_share_a_number() -> None:
    panels = json.loads((GRAFANA / "placefield.json").read_text())["panels"]
    cells = [
        (column, row)
        for panel in panels
        for at in [panel["gridPos"]]
        for column in range(at["x"], at["x"] + at["w"])
        for row in range(at["y"], at["y"] + at["h"])
    ]
    assert len(set(cells)) == len(cells)
    assert max(column for column, _ in cells) < 24
    assert len({panel["id"] for panel in panels}) == len(panels)


def test_the_job_that_is_scraped_is_the_one_that_the_board_shows(expressions: list[str]) -> None:
    (job,) = yaml.safe_load((GRAFANA / "prometheus.yaml").read_text())["scrape_configs"]
    shown = {name for expression in expressions for name in re.findall(r'job="(\w+)"', expression)}
    assert shown == {job["job_name"]}
