"""Pictures that move are shown to a reader, and written where a run keeps its figures."""

import numpy as np
from PIL import Image

from workbook import outcomes, pictures


def draw(figure, k):
    figure.add_axes((0, 0, 1, 1)).set_facecolor(("#E69F00", "#0072B2")[k % 2])


def colour(image, frame):
    image.seek(frame)
    return image.convert("RGB").getpixel((9, 9))


def test_a_named_flipbook_is_written_as_an_animation_with_each_picture_s_colours(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(outcomes, "OUTPUT_FOLDER", str(tmp_path))
    pictures.flipbook(draw, 4, "words")
    assert not [*tmp_path.iterdir()]
    pictures.flipbook(draw, 4, "words", name="pair")
    image = Image.open(tmp_path / "figures" / "pair.gif")
    assert image.n_frames == 4
    assert image.info["loop"] == 0
    for frame, expected in enumerate([(230, 159, 0), (0, 114, 178)] * 2):
        assert np.allclose(colour(image, frame), expected, rtol=0, atol=3)
