"""``placefield demo``: from frames to figures in one command."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield.config import Config
from placefield.evaluation.truth import Truth
from placefield_tools.cli import options

if TYPE_CHECKING:
    from placefield_tools.demo.light import Light

_FRAMES = 200  # of the rendered street
_NEXT = """
See it live, each command in a terminal of its own:
  placefield up {map}
  placefield dashboard {map}
  placefield replay {query} --rate 10"""


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("demo")(_demo)


def _demo(
    reference: Annotated[
        str | None,
        typer.Argument(metavar="REF", help="a folder or video", show_default="rendered"),
    ] = None,
    query: Annotated[
        str | None, typer.Argument(metavar="QUERY", help="a second drive of the same route")
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="folder for all files")] = Path(
        "demo"
    ),
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Build a map of a route, run the services, stream a second traverse, and show the accuracy.

    Without REF and QUERY, a street is rendered by day and at dusk.

    Examples:
      placefield demo
      placefield demo day/ dusk/
    """
    from placefield_tools.common.outputs import make_folder

    if (reference is None) != (query is None):
        raise typer.BadParameter("give both REF and QUERY, or neither")
    effective = options.effective_config(config, settings)
    make_folder(output)
    if reference is None or query is None:
        reference, query = _render(output, "day"), _render(output, "dusk")
    _run(reference, query, output, effective)


def _render(folder: Path, light: "Light") -> str:
    from placefield_tools.common.progress import progress_bar
    from placefield_tools.demo.rendered_traverse import render_traverse

    target = folder / light
    with progress_bar() as bar:
        task = bar.add_task(f"rendering a street, {light}", total=_FRAMES)
        render_traverse(target, light, frames=_FRAMES, on_frame=lambda _: bar.advance(task))
    return str(target)


def _run(reference: str, query: str, output: Path, config: Config) -> None:
    from placefield.maps.store import save_map
    from placefield_tools.build.map_from_sources import build_from
    from placefield_tools.common.progress import CONSOLE
    from placefield_tools.evaluate.evaluation import evaluate
    from placefield_tools.evaluate.evaluation_plots import draw
    from placefield_tools.evaluate.evaluation_report import print_table
    from placefield_tools.evaluate.query import Query
    from placefield_tools.inspect.map_summary import draw_segments

    map_path = output / "route.pfmap"
    built = build_from([reference], config)
    save_map(built, map_path)
    segments = output / "segments.png"
    draw_segments(built, segments)
    CONSOLE.print("starting the services and streaming the query through them, once per rule")

    def truth_of(queries: int, places: int) -> Truth:
        return Truth.within(queries, places, config.matching.tolerance)

    evaluation = evaluate(map_path, Query(query), truth_of, config, services=True)
    title = f"{Path(reference).name} → {Path(query).name}"
    print_table(evaluation, [segments, *draw(output, evaluation, title)])
    CONSOLE.print(_NEXT.format(map=map_path, query=query), markup=False, soft_wrap=True)
