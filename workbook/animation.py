"""Matplotlib's animations as a page can keep them."""

import base64
import io
import re

from PIL import Image


def plain_animation(html: str, words: str) -> str:
    """Make Matplotlib's HTML small and always the same, with `words` for who does not see it, its first frame shown."""
    html = re.sub(r"<link.*?>", "", html, flags=re.DOTALL)
    html = re.sub(r"(?<=base64,)[^\"]+", _reduce_png, html)
    html = html.replace(re.findall(r"_anim_img(\w{32})", html)[0], "_teeth")
    html = html.replace("width: 36px", "")
    # Words in place of the icons that it fetches.
    html = re.sub(r'aria-label="([^"]*)"( onclick="[^"]*">)\s*<i .*?</i>', r"\2\1", html)
    first = re.findall(r'frames\[0\] = "(.*?)"', html)[0]
    html = html.replace("<img ", f'<img alt="{words}" style="max-width: 100%" src="{first}" ')
    return html.replace("width: 374px", "width: 95%").replace('name="points"', 'aria-label="frame"')


def _reduce_png(found: re.Match) -> str:
    image = Image.open(io.BytesIO(base64.b64decode(found[0]))).convert("RGB").quantize(32)
    small = io.BytesIO()
    image.save(small, "PNG", optimize=True)
    return base64.b64encode(small.getvalue()).decode()
