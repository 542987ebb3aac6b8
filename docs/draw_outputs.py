"""Draw docs/outputs.png: each output of docs/outputs.toml as the PNG that the command line writes of it."""

from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure
from matplotlib.image import imread

import jaxrt
from jaxrt.io.layers import png_beside

DOCS = Path(__file__).parent
ROWS = (
    ("radiance", "foreground", "sky", "alpha", "depth", "position"),
    ("normal", "albedo", "uv", "mask[apple]", "shape", "material"),
)


def main() -> None:
    """Draw the outputs in two rows."""
    scene = jaxrt.load_scene(DOCS / "outputs.toml")
    names = sum(ROWS, ())
    found = jaxrt.render(scene, 0, spp=16, outputs=names)
    figure = Figure(figsize=(12, 3.6), layout="constrained")
    with TemporaryDirectory() as folder:
        path = Path(folder, "a.png")
        jaxrt.save_image(path, found)
        for axes, name in zip(figure.subplots(2, 6).flat, names, strict=True):
            axes.set_facecolor("#d5e5d5")  # what alpha lets through
            if name == "alpha":  # is in the foreground's
                axes.imshow(found[name], cmap="gray")
            else:
                axes.imshow(imread(path if name == "foreground" else png_beside(path, name)))
            axes.set_title(name, fontsize=10)
            axes.set_xticks([])
            axes.set_yticks([])
    figure.savefig(DOCS / "outputs.png", dpi=80)


if __name__ == "__main__":
    main()
