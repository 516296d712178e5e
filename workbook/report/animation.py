"""Matplotlib's animations as a page can keep them."""

import base64
import json
import re

from workbook.report.figures import reduce_png

# No element has an id: two copies of it may lie in one page.
PLAYER = """<div class="animation"><img alt="WORDS" style="max-width: 100%" src="FIRST">
<div><button type="button">play</button>
<input type="range" min="0" max="LAST" value="0" style="width: 80%" aria-label="frame"></div></div>
<script>{
const player = document.currentScript.previousElementSibling, frames = FRAMES;
const [picture, button, slider] = ["img", "button", "input"].map(name => player.querySelector(name));
const show = k => { slider.value = k; picture.src = frames[k]; };
let playing = 0;
const pause = () => { playing = clearInterval(playing); button.textContent = "play"; };
const play = () => {
  playing = setInterval(() => show((+slider.value + 1) % frames.length), INTERVAL);
  button.textContent = "pause";
};
button.addEventListener("click", () => playing ? pause() : play());
slider.addEventListener("input", () => { pause(); show(+slider.value); });
}</script>"""


def plain_animation(html: str, words: str) -> str:
    """Make Matplotlib's HTML small and always the same, with `words` for who does not see it, its first frame shown."""
    drawn = re.findall(r"frames\[\d+\] = \"data:image/png;base64,(.*?)\"", html, re.DOTALL)
    frames = [reduce_png(base64.b64decode(frame.replace("\\", ""))) for frame in drawn]
    (interval,) = re.findall(r"new Animation\(frames, img_id, slider_id, ([\d.]+),", html)
    parts = {
        "WORDS": words,
        "FIRST": frames[0],
        "LAST": str(len(frames) - 1),
        "FRAMES": json.dumps(frames),
        "INTERVAL": interval,
    }
    return re.sub("|".join(parts), lambda part: parts[part[0]], PLAYER)
