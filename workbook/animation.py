"""Matplotlib's animations as a page can keep them."""

import base64
import io
import json
import re
from functools import cache
from string import Template

from PIL import Image

COLOURS = 48  # enough for lines and markers with smooth edges; a third of the size

# No element has an id: two copies of it may lie in one page.
PLAYER = Template("""<div class="animation"><img alt="$words" style="max-width: 100%" src="$first">
<div><button type="button">play</button>
<input type="range" min="0" max="$last" value="0" style="width: 80%" aria-label="frame"></div></div>
<script>{
const player = document.currentScript.previousElementSibling, frames = $frames;
const [picture, button, slider] = ["img", "button", "input"].map(name => player.querySelector(name));
const show = k => { slider.value = k; picture.src = frames[k]; };
let playing = 0;
const pause = () => { playing = clearInterval(playing); button.textContent = "play"; };
const play = () => {
  playing = setInterval(() => show((+slider.value + 1) % frames.length), $interval);
  button.textContent = "pause";
};
button.addEventListener("click", () => playing ? pause() : play());
slider.addEventListener("input", () => { pause(); show(+slider.value); });
}</script>""")


def plain_animation(html: str, words: str) -> str:
    """Make Matplotlib's HTML small and always the same, with `words` for who does not see it, its first frame shown."""
    drawn = re.findall(r"frames\[\d+\] = \"data:image/png;base64,(.*?)\"", html, re.DOTALL)
    frames = [reduce_png(base64.b64decode(frame.replace("\\", ""))) for frame in drawn]
    (interval,) = re.findall(r"new Animation\(frames, img_id, slider_id, ([\d.]+),", html)
    return PLAYER.substitute(
        words=words,
        first=frames[0],
        last=len(frames) - 1,
        frames=json.dumps(frames),
        interval=interval,
    )


@cache
def reduce_png(content: bytes) -> str:
    """Turn a PNG into a data address, with few colours."""
    image = Image.open(io.BytesIO(content)).convert("RGB")
    few = image.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    few.convert("RGB").save(buffer, "WEBP", lossless=True, quality=80, method=4)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
