import numpy as np
import pytest

from ocplanner.drawing.overlay import Caption, caption_height, draw_caption, draw_paths, enlarge
from ocplanner.drawing.style import BAD, GOOD
from ocplanner.errors import ShapeError

GREY = np.full((320, 320, 3), 128, dtype=np.uint8)


def test_the_plan_is_red_and_what_was_achieved_is_cyan():
    planned, achieved = np.array([[100.0, 200.0]]), np.array([[20.0, 40.0], [60.0, 40.0]])
    image = draw_paths(GREY, planned, achieved)
    assert image[200, 100].tolist() == [255, 43, 43]
    red, green, blue = image[40, 40].astype(int)
    assert red < 60 < 200 < min(green, blue)
    np.testing.assert_array_equal(image[300], GREY[300])
    assert (GREY == 128).all()


def test_a_plan_of_few_steps_stands_out_as_one_of_many_does():
    def red(steps: int) -> int:
        image = draw_paths(GREY, np.linspace([150.0, 160.0], [150.0 + 0.8 * steps, 160.0], steps), None).astype(int)
        return int((image[..., 0] - image[..., 1] > 150).sum())

    assert red(5) > 50
    assert red(5) > 0.5 * red(20)


@pytest.mark.parametrize("pixels", [None, np.zeros((0, 2)), np.full((3, 2), np.nan)])
def test_nothing_to_draw_leaves_the_image_as_it_is(pixels):
    np.testing.assert_array_equal(draw_paths(GREY, pixels, pixels), GREY)


def test_points_outside_the_image_are_no_error():
    assert draw_paths(GREY, np.array([[-1e4, 5.0]]), np.array([[-5.0, 5.0], [900.0, 5.0]])).shape == GREY.shape


@pytest.mark.parametrize("image", [GREY[..., 0], GREY.astype(float)])
def test_images_of_another_kind_are_refused(image):
    with pytest.raises(ShapeError):
        draw_paths(image, None, None)


def test_the_caption_adds_a_bar_and_shows_the_verdict_in_colour():
    running = draw_caption(GREY, Caption("Sawyer", "seed 10003", "follow · step 57"))
    assert running.shape == (320 + caption_height(320), 320, 3)
    np.testing.assert_array_equal(running[:320], GREY)
    success = draw_caption(GREY, Caption("Sawyer", "seed 10003", "step 57", "success", GOOD))[320:].astype(int)
    failed = draw_caption(GREY, Caption("Sawyer", "seed 10003", "step 57", "not aligned", BAD))[320:].astype(int)
    assert ((success[..., 1] - success[..., 0]) > 80).any()
    assert ((failed[..., 0] - failed[..., 2]) > 80).any()


@pytest.mark.parametrize("width", [84, 161, 320, 640])
def test_the_bar_has_an_even_height(width):
    assert caption_height(width) % 2 == 0


def test_small_images_are_enlarged_and_others_are_not():
    image, factor = enlarge(GREY[:84, :84], 320)
    assert image.shape == (320, 320, 3)
    assert factor == pytest.approx(320 / 84)
    assert enlarge(GREY, 320)[0] is GREY
    assert enlarge(GREY[:161, :163], 100)[0].shape[:2] in {(160, 162), (160, 164), (162, 162), (162, 164)}
