"""Printing the registry of networks."""

from collections.abc import Iterable
from textwrap import dedent

from rich.console import Console
from rich.table import Table

from placefield_tools.models.getting import toml_of
from placefield_tools.models.registry import Model


def print_list(models: Iterable[Model]) -> None:
    """Print the names of networks, what they are, and how to get them."""
    table = Table("name", "network", "dimension", "to get")
    for known in models:
        how = "models get" if known.url is not None else "export"
        table.add_row(known.name, known.about, str(known.dimension), how)
    Console(markup=False).print(table)
    print("'placefield models show NAME' prints the licences, the input and how to get it")


def print_model(known: Model) -> None:
    """Print all facts about a network."""
    for word, text in (
        ("network", known.about),
        ("page", known.page),
        ("code", known.code_licence),
        ("weights", known.weights_licence),
        ("dimension", str(known.dimension)),
        ("from", known.url),
        ("size", f"{known.bytes} bytes" if known.bytes is not None else None),
        ("SHA-256", known.sha256),
        ("to get", f"placefield models get {known.name}" if known.url else "run the lines below"),
    ):
        if text:
            print(f"{word + ':':<11}{text}")
    print(f"\n# {known.name}.toml\n{toml_of(known)}")
    if known.export is not None:
        print(export_script(known))


def export_script(known: Model) -> str:
    """Return a Python program that exports a network by its authors' code.

    It needs ``torch``, ``onnx`` and what the authors' code needs.
    """
    made = known.export or ""
    made = made.strip() if "network =" in made else f"network = {made}"
    shape = (1, known.input.channels, known.input.height, known.input.width)
    return (
        dedent("""
        # export.py, which needs torch and what the authors' code needs
        import torch

        {made}


        class Feature(torch.nn.Module):
            def __init__(self):
                super().__init__()
                self.network = network

            def forward(self, image):
                output = self.network(image)
                return output[0] if isinstance(output, tuple) else output


        torch.onnx.export(
            Feature().eval(),
            torch.zeros{shape},
            "{name}.onnx",
            input_names=["image"],
            output_names=["feature"],
            opset_version=17,
            dynamo=False,
        )
        """)
        .format(made=made, shape=shape, name=known.name)
        .strip()
    )
