"""The paper's experiments as one HTML page, to be read and printed without a network."""

from pathlib import Path
from typing import Any

from placefield_tools.study.figures import groups, neighbourhoods
from placefield_tools.study.pages import write_page
from placefield_tools.study.paper import paper_figures as figures
from placefield_tools.study.paper import verdicts
from placefield_tools.study.paper.cost import (
    COMPARISONS_PER_SECOND,
    comparisons,
    multiplications,
)
from placefield_tools.study.paper.paper_results import Cost, FeatureResult, PaperStudy


def write_paper_report(folder: Path, study: PaperStudy) -> Path:
    """Write the experiments as `report.html` into a folder; return the file.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    return write_page(
        folder,
        "paper/report.html.j2",
        study=study,
        title=f"{Path(study.query).name} along {Path(study.reference).name}",
        curves=figures.compared_curves(study),
        bars=figures.compared_bars(study),
        channel_counts=figures.channel_counts(study),
        features=[_shown(result) for result in study.features],
    )


def _shown(result: FeatureResult) -> dict[str, Any]:
    return {
        "result": result,
        "of_methods": verdicts.of_methods(result),
        "of_channels": verdicts.of_channels(result),
        "scale_curves": figures.scale_curves(result),
        "groups": groups(result.fixed, result.placemap),
        "clusters": figures.clusters(result),
        "segments": figures.segments(result),
        "autocorrelograms": figures.autocorrelograms(result),
        "neighbourhoods": neighbourhoods(result.learned),
        "costs": _costs(result.cost),
    }


def _costs(cost: Cost) -> list[tuple[str, str, str, str]]:
    """Return rows of the table: what, comparisons or products, memory and frames per second."""
    return [
        ("AMS and MS, as the paper counts", *_counted(comparisons(cost))),
        ("one scale, as the paper counts", *_counted(comparisons(cost, one_scale=True))),
        (
            "AMS here, measured",
            f"{multiplications(cost) / 1e6:.1f} million products",
            f"{cost.kept_bytes / 2**20:.1f} MB",
            f"{1 / cost.seconds:.0f}",
        ),
    ]


def _counted(number: int) -> tuple[str, str, str]:
    return (
        f"{number / 1e6:.1f} million comparisons",
        f"{number / 2**20:.1f} MB",
        f"{COMPARISONS_PER_SECOND / number:.1f}",
    )
