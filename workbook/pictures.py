"""Pictures, the same bytes from run to run: figures in files, and those that a reader leafs through."""

import base64
import io
import json
from collections.abc import Callable
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from workbook.project import find_hook

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# No element has an id: two of them may lie in one page.
PLAYER = Template("""<div><img alt="$words" style="max-width: 100%" src="$picture"><br>
<button type="button">play</button>
<input type="range" min="0" max="$last" value="$first" style="width: 80%" aria-label="picture"></div>
<script>{
const pictures = $pictures, player = document.currentScript.previousElementSibling;
const [picture, button, slider] = ["img", "button", "input"].map(name => player.querySelector(name));
const show = k => { slider.value = k; picture.src = pictures[k]; };
let playing = 0;
const pause = () => { playing = clearInterval(playing); button.textContent = "play"; };
button.addEventListener("click", () => {
  if (playing) return pause();
  playing = setInterval(() => show((+slider.value + 1) % pictures.length), 100);
  button.textContent = "pause";
});
slider.addEventListener("input", () => { pause(); show(+slider.value); });
}</script>""")


def save(figure: "Figure", folder: Path, name: str, mark: str = "") -> None:
    """Write a figure as SVG and PNG, without anything that differs from run to run; a mark stands across it."""
    from matplotlib import rc_context  # slow to import, and not every command draws

    folder.mkdir(parents=True, exist_ok=True)
    if mark:
        figure.text(
            0.5,
            0.5,
            mark,
            ha="center",
            va="center",
            fontsize=40,
            color="0.6",
            alpha=0.4,
            rotation=20,
        )
    with rc_context(find_style()):
        about = {"Date": None, "Description": describe_axes(figure)}
        figure.savefig(folder / f"{name}.svg", metadata=about)
        figure.savefig(folder / f"{name}.png", dpi=200)


def find_style() -> Any:
    """The settings of matplotlib in which the project draws; the ids in an SVG never are by chance."""
    return {"svg.hashsalt": "workbook"} | find_hook("style", {})


def describe_axes(figure: "Figure") -> str:
    """Say what a figure's axes are, a panel each: the SVG's description, and what reads it aloud says."""
    labels = [(axis.get_ylabel(), axis.get_xlabel()) for axis in figure.axes]
    panels = [" versus ".join(filter(None, pair)) for pair in labels]
    return "; ".join(dict.fromkeys(filter(None, panels))).replace("\n", " ")


COLOURS = 64  # of an animation
PICTURE_MS = 100


def flipbook(
    draw: Callable[["Figure", int], None], count: int, words: str, first: int = 0, name: str = ""
) -> None:
    """Show pictures 0 to count - 1, each drawn on an empty figure by `draw(figure, k)`, with a slider.

    Without scripts a page shows the first one; who does not see them reads `words`. With a name the pictures are
    written to `figures/NAME.gif`, too; by hand nothing is written.
    """
    from IPython.display import display
    from matplotlib import pyplot as plt
    from matplotlib import rc_context

    from workbook.outcomes import OUTPUT_FOLDER

    def picture(k: int, **how: Any) -> bytes:
        figure.clear()
        draw(figure, k)
        buffer = io.BytesIO()
        figure.savefig(buffer, **how)
        return buffer.getvalue()

    # Axes stand where `draw` puts them: a layout engine would find none of its own, and warn.
    with rc_context(find_style() | {"figure.constrained_layout.use": False}):
        figure = plt.figure(figsize=(7, 3.6), dpi=80)
        lossless = {"lossless": True, "method": 2}
        contents = [picture(k, format="webp", pil_kwargs=lossless) for k in range(count)]
        png = picture(first, format="png")
        plt.close(figure)
    texts = [base64.b64encode(content).decode("ascii") for content in contents]
    pictures = [f"data:image/webp;base64,{text}" for text in texts]
    if name and OUTPUT_FOLDER:
        write_animation(contents, Path(OUTPUT_FOLDER) / "figures" / f"{name}.gif")
    player = PLAYER.substitute(
        words=words,
        picture=pictures[first],
        pictures=json.dumps(pictures),
        first=first,
        last=count - 1,
    )
    shown = {"text/html": player, "image/png": png, "text/plain": words}
    display(shown, raw=True)


def write_animation(pictures: list[bytes], file: Path) -> None:
    """Write pictures as a GIF that plays without end, all in one set of colours."""
    import numpy as np
    from PIL import Image

    images = [Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures]
    palette = Image.fromarray(np.vstack([np.asarray(image) for image in images])).quantize(COLOURS)
    first, *others = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
    file.parent.mkdir(parents=True, exist_ok=True)
    first.save(file, save_all=True, append_images=others, duration=PICTURE_MS, loop=0)
